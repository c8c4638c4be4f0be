"""Croissant, the JSON-LD that dataset search engines and conferences ask for.

Croissant format specification 1.1 and its RAI extension 1.0 (MLCommons), without dates of its own.
"""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from swarmdata.datasets.dataset import Dataset
from swarmdata.hub.publishing.metadata.episode_parquet import EPISODE_COLUMNS, EPISODES_FILE
from swarmdata.registry.published import license_of
from swarmdata.specs.origins import Origin
from swarmdata.store import SPLITS
from swarmdata.store.arrays.layout import MANIFEST

CROISSANT_FILE = "croissant.json"

LICENSES = {
    "apache-2.0": "https://www.apache.org/licenses/LICENSE-2.0",
    "cc-by-4.0": "https://creativecommons.org/licenses/by/4.0/",
    "cc-by-sa-4.0": "https://creativecommons.org/licenses/by-sa/4.0/",
    "cc0-1.0": "https://creativecommons.org/publicdomain/zero/1.0/",
    "mit": "https://opensource.org/licenses/MIT",
}
"""Addresses of the licenses by the Hub's names for them."""

_OF_CROISSANT = (
    "arrayShape", "citeAs", "column", "containedIn", "equivalentProperty", "extract", "field",
    "fileObject", "fileProperty", "fileSet", "format", "includes", "isArray", "isLiveDataset",
    "jsonPath", "key", "md5", "parentField", "path", "recordSet", "references", "regex", "repeated",
    "replace", "samplingRate", "separator", "source", "subField", "transform",
)  # fmt: skip
"""Terms that only have Croissant's prefix."""

_OTHERS = {
    "@language": "en",
    "@vocab": "https://schema.org/",
    "conformsTo": "dct:conformsTo",
    "cr": "http://mlcommons.org/croissant/",
    "data": {"@id": "cr:data", "@type": "@json"},
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
    "dct": "http://purl.org/dc/terms/",
    "description": {"@container": "@language"},
    "examples": {"@id": "cr:examples", "@type": "@json"},
    "name": {"@container": "@language"},
    "prov": "http://www.w3.org/ns/prov#",
    "rai": "http://mlcommons.org/croissant/RAI/",
    "sc": "https://schema.org/",
}

_CONTEXT = dict(sorted({**{term: f"cr:{term}" for term in _OF_CROISSANT}, **_OTHERS}.items()))
"""The context of Croissant 1.1, which validators compare word by word, and PROV."""

_SPLIT_KINDS = {
    "train": "cr:TrainingSplit",
    "validation": "cr:ValidationSplit",
    "test": "cr:TestSplit",
}

_TYPES = {
    "split": "sc:Text",
    "end_reason": "sc:Text",
    "policy": "sc:Text",
    "team_return": "sc:Float",
    "success": "sc:Boolean",
}
"""Columns of the episode table that are not integers."""


def croissant(dataset: Dataset, tables: Mapping[str, bytes]) -> bytes:
    """Returns `croissant.json` of a whole dataset, with a record set of the tables beside it."""
    recipe = dataset.recipe
    content = {
        "@context": _CONTEXT,
        "@type": "sc:Dataset",
        "conformsTo": "http://mlcommons.org/croissant/1.1",
        "name": dataset.id,
        "description": _description(dataset),
        "version": f"{dataset.id.rpartition('-v')[2]}.0.0",
        "license": LICENSES.get(license_of(dataset.recipe), license_of(dataset.recipe)),
        "creator": {
            "@type": "Organization",
            "name": (recipe.metadata or {}).get("author", "swarmdata"),
        },
        "citeAs": _citation(dataset),
        "keywords": [
            "offline reinforcement learning",
            "multi-agent",
            recipe.spec.task,
            recipe.tier,
        ],
        "isLiveDataset": False,
        **_responsible(dataset),
        "distribution": _distribution(dataset, tables),
        **({"recordSet": _record_sets()} if EPISODES_FILE in tables else {}),
    }
    return json.dumps(content, indent=1, allow_nan=False).encode() + b"\n"


def _description(dataset: Dataset) -> str:
    recipe = dataset.recipe
    return (
        f"Offline multi-agent reinforcement learning: {len(dataset):,} episodes, "
        f"{dataset.n_steps:,} joint steps of {dataset.spec.n_agents} agents in {recipe.spec.task}, "
        f"tier {recipe.tier}. Arrays are Zarr v3 without compression; the episode table is "
        f"{EPISODES_FILE}. Logical digest of the arrays: {dataset.digest}."
    )


def _citation(dataset: Dataset) -> str:
    key = dataset.id.replace("-", "_")
    return f"@misc{{{key}, title={{{dataset.id}}}, note={{swarmdata, digest {dataset.digest}}}}}"


class _Known(NamedTuple):
    """What the kind of an origin tells of its episodes."""

    how: str
    is_synthetic: bool | None = None
    limits: str = "Not known to the converter."
    people: str = "Not known to the converter."


_SIMULATED = _Known(
    "Recorded in simulation", True, "Simulation only; no claim about physical robots.",
    "None: no person took part.",
)  # fmt: skip

_LOGGED = _Known(
    "Imported from logs of robots", False,
    "Motion of the robots that were logged; no simulator is bound to it.",
)  # fmt: skip


def _known(origin: Origin) -> _Known:
    if origin.kind == "edit" and origin.spec.world is not None:
        how = f"{_SIMULATED.how}, and made from other datasets by: {origin.source}"
        return _SIMULATED._replace(how=how)
    by_kind = {"recipe": _SIMULATED, "logs": _LOGGED}
    return by_kind.get(origin.kind, _Known(f"Source: {origin.source}"))


def _responsible(dataset: Dataset) -> dict[str, Any]:
    """The fields of the RAI extension and of PROV; nothing is claimed that the origin lacks."""
    origin, known = dataset.recipe, _known(dataset.recipe)
    labels = ", ".join(source.label for source in origin.policies)
    synthetic = {} if known.is_synthetic is None else {"rai:hasSyntheticData": known.is_synthetic}
    return {
        "rai:dataCollection": f"{known.how}. Behavior policies: {labels}.",
        "rai:dataCollectionType": "Software Collection",
        **synthetic,
        "rai:dataBiases": "Episodes are those of the behavior policies; states that these do not "
        "visit are absent.",
        "rai:dataLimitations": known.limits,
        "rai:dataUseCases": "Training and evaluation of offline multi-agent learning.",
        "rai:dataSocialImpact": "Policies learned offline may collide or fail on robots and among "
        "people; these data say nothing about safety there.",
        "rai:personalSensitiveInformation": known.people,
        "rai:dataReleaseMaintenancePlan": "A published version never changes from version 1 on; "
        "corrections get a new version.",
        "prov:wasGeneratedBy": {
            "@type": "prov:Activity",
            "name": f"swarmdata, {origin.kind} {origin.hash()}",
            "description": ", ".join(
                f"{name} {version}"
                for name, version in sorted(dataset.stored.manifest.provenance.items())
            ),
        },
        "prov:wasDerivedFrom": [
            {"@type": "prov:Entity", "name": parent.id, "identifier": f"sha256:{parent.digest}"}
            for parent in origin.parents
        ],
    }


def _distribution(dataset: Dataset, tables: Mapping[str, bytes]) -> list[dict[str, Any]]:
    files = dataset.stored.manifest.files
    entries = [_file(path, files[path].size, files[path].sha256) for path in sorted(files)]
    manifest = (dataset.path / MANIFEST).read_bytes()
    for path, content in {MANIFEST: manifest, **tables}.items():
        entries.append(_file(path, len(content), hashlib.sha256(content).hexdigest()))
    return entries


def _file(path: str, size: int, sha256: str) -> dict[str, Any]:
    kinds = {".json": "application/json", ".parquet": "application/x-parquet"}
    return {
        "@type": "cr:FileObject",
        "@id": path,
        "name": path,
        "contentUrl": path,
        "contentSize": f"{size} B",
        "encodingFormat": kinds.get(Path(path).suffix, "application/octet-stream"),
        "sha256": sha256,
    }


def _record_sets() -> list[dict[str, Any]]:
    splits = {
        "@type": "cr:RecordSet",
        "@id": "splits",
        "name": "splits",
        "description": "Splits of the episodes.",
        "dataType": "cr:Split",
        "key": {"@id": "splits/name"},
        "field": [
            {"@type": "cr:Field", "@id": "splits/name", "dataType": "sc:Text"},
            {"@type": "cr:Field", "@id": "splits/url", "dataType": "sc:URL"},
        ],
        "data": [{"splits/name": name, "splits/url": _SPLIT_KINDS[name]} for name in SPLITS],
    }
    episodes = {
        "@type": "cr:RecordSet",
        "@id": "episodes",
        "name": "episodes",
        "description": "One row per episode.",
        "key": {"@id": "episodes/episode"},
        "field": [_field(name, meaning) for name, meaning in EPISODE_COLUMNS.items()],
    }
    return [splits, episodes]


def _field(name: str, meaning: str) -> dict[str, Any]:
    refers = {"references": {"field": {"@id": "splits/name"}}} if name == "split" else {}
    return {
        "@type": "cr:Field",
        "@id": f"episodes/{name}",
        "name": f"episodes/{name}",
        "description": meaning,
        "dataType": _TYPES.get(name, "sc:Integer"),
        "source": {"fileObject": {"@id": EPISODES_FILE}, "extract": {"column": name}},
        **refers,
    }
