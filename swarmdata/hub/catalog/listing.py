"""The datasets there are: published ones, and others in the cache."""

from dataclasses import dataclass
from pathlib import Path

from swarmdata.errors import DatasetError, SwarmdataError
from swarmdata.registry.published import published, references
from swarmdata.registry.tiers import Outline, outlines
from swarmdata.runtime.cache_folder import MANIFEST, cache_folder
from swarmdata.runtime.outside_names import is_id


@dataclass(frozen=True)
class DatasetInfo:
    """One line of the catalog; figures that are unknown before a first build are None."""

    id: str
    task: str
    tier: str
    n_agents: int
    n_steps: int
    n_episodes: int | None
    n_bytes: int | None
    score: float | None  # of the mean return of its episodes; 0 no skill, 100 expert
    digest: str | None
    is_cached: bool


def dataset_folder(dataset_id: str) -> Path:
    """Where the cache keeps a dataset, whether it is there or not."""
    return cache_folder() / "datasets" / dataset_id


def list_datasets() -> list[DatasetInfo]:
    """Returns every dataset of this version of the package, in the order of their ids."""
    return [_info(dataset_id, outline) for dataset_id, outline in sorted(outlines().items())]


def _info(dataset_id: str, outline: Outline) -> DatasetInfo:
    """Neither the recipe nor, of what is published, the spec is read: each takes milliseconds."""
    entry, anchors = published().get(dataset_id), references().get(outline.family)
    if entry is None:
        from swarmdata.registry.presets import preset  # noqa: PLC0415  (only before publication)
    known = entry or preset(outline.family)
    return DatasetInfo(
        id=dataset_id,
        task=known.task,
        tier=outline.tier,
        n_agents=known.n_agents,
        n_steps=entry.n_steps if entry else outline.n_steps,
        n_episodes=entry.n_episodes if entry else None,
        n_bytes=entry.n_bytes if entry else None,
        score=anchors.score(entry.mean_return) if entry and anchors else None,
        digest=entry.digest if entry else None,
        is_cached=(dataset_folder(dataset_id) / MANIFEST).exists(),
    )


def cached_ids(place: Path) -> list[str]:
    """Ids of the finished datasets in a cache's folder of datasets."""
    return [
        path.name for path in place.glob("*-v*") if is_id(path.name) and (path / MANIFEST).exists()
    ]


def own_datasets() -> tuple[list[DatasetInfo], list[str]]:
    """Returns the datasets in the cache that the package has no recipe of, by id.

    Beside them, one sentence for each folder that is no usable dataset says why it is none.
    """
    place = cache_folder() / "datasets"
    found, problems = [], []
    for name in sorted(set(cached_ids(place)) - outlines().keys()):
        try:
            found.append(_info_of_folder(place / name))
        except (SwarmdataError, OSError) as error:
            problems.append(f"{place / name}: {error}")
    return found, problems


def _info_of_folder(folder: Path) -> DatasetInfo:
    # what reads datasets takes as long as all the rest, and most caches have published ones only
    from swarmdata.hub.catalog.identity import misnamed  # noqa: PLC0415
    from swarmdata.runtime.documents import MAX_JSON_BYTES  # noqa: PLC0415
    from swarmdata.runtime.regular_files import read_regular  # noqa: PLC0415
    from swarmdata.store import read_manifest  # noqa: PLC0415
    from swarmdata.store.arrays.layout import RECIPE  # noqa: PLC0415
    from swarmdata.store.stored_dataset import check_listing, read_origin  # noqa: PLC0415

    manifest = read_manifest(folder)
    check_listing(folder, manifest)
    recipe = read_origin(folder, manifest, read_regular(folder / RECIPE, MAX_JSON_BYTES))
    if (sentence := misnamed(folder, manifest)) is not None:
        raise DatasetError(f"{sentence}.")
    return DatasetInfo(
        id=manifest.id,
        task=recipe.spec.task,
        tier=recipe.tier,
        n_agents=recipe.spec.n_agents,
        n_steps=manifest.n_steps,
        n_episodes=manifest.n_episodes,
        n_bytes=sum(file.size for file in manifest.files.values()),
        score=None,
        digest=manifest.digest,
        is_cached=True,
    )
