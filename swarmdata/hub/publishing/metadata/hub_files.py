"""What goes to a hub beside a dataset's own files: episode tables, Croissant, and the card there.

The manifest does not list these files: every upload makes them again from the dataset.
"""

from importlib.util import find_spec
from pathlib import Path
from typing import Any

import yaml

from swarmdata.cards.sections.front_matter import front_content
from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import SchemaError, SpecError
from swarmdata.hub.publishing.metadata.croissant import CROISSANT_FILE, croissant
from swarmdata.hub.publishing.metadata.episode_parquet import (
    EPISODES_FILE,
    episode_table,
    parquet_bytes,
)
from swarmdata.runtime.yaml_documents import parse_yaml
from swarmdata.store import SPLITS, write_file

README_FILE = "README.md"  # what the Hub shows of a repository

_DTYPES = {"double": "float64"}  # names of `datasets` for types of Arrow, where they differ

EPISODES_CONFIG = "episodes"  # name of the configuration that the Hub's viewer shows


def metadata_files(folder: Path) -> dict[str, bytes]:
    """Returns the files to upload beside a dataset's own, by path; nothing is written.

    `episodes.parquet` with all episodes and `episodes/<split>.parquet` with those of each split,
    where pyarrow is installed (the extra `parquet`), and `croissant.json` always.
    """
    dataset = Dataset.open(folder)
    tables = _tables(dataset)
    return {**tables, CROISSANT_FILE: croissant(dataset, tables)}


def write_beside(folder: Path, out: Path) -> None:
    """Writes what is published beside a dataset: `metadata_files`, and the Hub's `README.md`."""
    for name, content in metadata_files(folder).items():
        write_file(out / name, content)
    write_file(out / README_FILE, hub_card(folder).encode())


def _tables(dataset: Dataset) -> dict[str, bytes]:
    if find_spec("pyarrow") is None:
        return {}
    table = episode_table(dataset)
    parts = {_split_file(name): part for name, part in _parts(dataset, table).items()}
    return {path: parquet_bytes(each) for path, each in ({EPISODES_FILE: table} | parts).items()}


def _split_file(split: str) -> str:
    return f"episodes/{split}.parquet"


def _parts(dataset: Dataset, table: Any) -> dict[str, Any]:
    """The rows of each split that has episodes."""
    masks = {name: dataset.episodes.split == code for code, name in enumerate(SPLITS)}
    return {name: table.filter(mask) for name, mask in masks.items() if mask.any()}


def hub_card(folder: Path) -> str:
    """Returns the README.md of a dataset's repository: its card, with what the Hub reads in front.

    The card's own front matter is kept; what it lacks is added.
    """
    dataset = Dataset.open(folder)
    front, text = _parsed(dataset.card, dataset.path)
    known = front_content(dataset.stored.manifest, dataset.recipe)
    content = {**known, "annotations_creators": ["machine-generated"], **front}
    if find_spec("pyarrow") is not None:
        content |= _configuration(dataset)
    return f"---\n{yaml.safe_dump(content, sort_keys=False, allow_unicode=True)}---\n{text}"


def _parsed(card: str, path: Path) -> tuple[dict[str, Any], str]:
    """Front matter and text of a card, which need not have the former."""
    if not card.startswith("---\n"):
        return {}, f"\n{card}"
    head, mark, text = card.removeprefix("---\n").partition("\n---\n")
    try:
        front = parse_yaml(head, "the card's front matter") if mark else None
    except SpecError:
        front = None
    if not isinstance(front, dict):
        raise SchemaError(
            f"the front matter of the card of {path} is not YAML between two lines ---. Write the "
            "card again with `swarmdata card --write`."
        )
    return front, text


def _configuration(dataset: Dataset) -> dict[str, Any]:
    table = episode_table(dataset)
    parts = _parts(dataset, table)
    files = [{"split": name, "path": _split_file(name)} for name in parts]
    splits = [
        {"name": name, "num_bytes": part.nbytes, "num_examples": part.num_rows}
        for name, part in parts.items()
    ]
    info = {
        "config_name": EPISODES_CONFIG,
        "features": [
            {"name": f.name, "dtype": _DTYPES.get(str(f.type), str(f.type))} for f in table.schema
        ],
        "splits": splits,
        "download_size": sum(len(parquet_bytes(part)) for part in parts.values()),
        "dataset_size": sum(part.nbytes for part in parts.values()),
    }
    configuration = {"config_name": EPISODES_CONFIG, "default": True, "data_files": files}
    return {"configs": [configuration], "dataset_info": info}
