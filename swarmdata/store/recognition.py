"""Recognises a dataset's folder by contents that only our datasets have; changes nothing."""

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from swarmdata.store.arrays.layout import GROUP_FILES, MANIFEST

MAX_EVIDENCE_BYTES = 64 << 20
"""Larger files are not read to recognise a dataset; a manifest may be as large."""

ROOT_ATTRIBUTES = frozenset({"id", "splits", "end_reasons", "policies", "time_arrays"})
"""Keys that the root group of every dataset has among its attributes."""

_MANIFEST_KEYS = frozenset({"checksum", "format_version", "recipe_hash", "arrays", "files"})


def is_dataset(folder: Path) -> bool:
    """Whether a folder is a dataset of swarmdata, whole or damaged.

    One of these must be left of it: a manifest with our keys, or a root group with our attributes.
    Names alone, a `recipe.json`, or foreign arrays are no evidence.
    """
    return (
        _read_object(folder / MANIFEST).keys() >= _MANIFEST_KEYS
        or root_attributes(folder).keys() >= ROOT_ATTRIBUTES
    )


def no_folder(path: Path | str) -> str:
    """Says that a dataset is not there, and how to get a published one."""
    return (
        f"there is no dataset folder at {path}. `swarmdata generate ID` makes a published dataset, "
        "`swarmdata list` has the ids."
    )


def no_dataset(folder: Path) -> str:
    """The message that a folder is no dataset."""
    return (
        f"there is no dataset at {folder}: the folder has nothing that only a dataset of swarmdata "
        f"has, such as a manifest.{linked_hint(folder)}"
    )


def linked_hint(folder: Path) -> str:
    """How to download a dataset whose files are links, as in huggingface_hub's cache; else ""."""
    if not (folder / MANIFEST).is_symlink():
        return ""
    return (
        " Its files are links, as in the cache of huggingface_hub, and links are never followed. "
        "Copy the files: snapshot_download(..., local_dir=FOLDER), or `swarmdata pull "
        "hf://ORG/NAME --out FOLDER`."
    )


def root_attributes(folder: Path) -> Mapping[str, Any]:
    """The attributes of a dataset's root group, none where its file is absent or broken."""
    found = _read_object(folder / GROUP_FILES[0]).get("attributes")
    return found if isinstance(found, dict) else {}


def _read_object(path: Path) -> Mapping[str, Any]:
    """The JSON object in a plain file; empty where there is none. Links are not followed."""
    try:
        if path.is_symlink() or not path.is_file() or path.stat().st_size > MAX_EVIDENCE_BYTES:
            return {}
        found = json.loads(path.read_bytes())
    except (OSError, ValueError, RecursionError):
        return {}
    return found if isinstance(found, dict) else {}


def links_in(path: Path) -> tuple[str, ...]:
    """Every symbolic link below a folder, relative to it and sorted; links are not followed.

    With `os.scandir`, whose entries know what they are: this is part of every `load`.
    """
    found, waiting = [], [""]
    while waiting:
        inside = waiting.pop()
        with os.scandir(os.path.join(path, inside)) as entries:  # noqa: PTH118
            for entry in entries:
                name = f"{inside}/{entry.name}" if inside else entry.name
                if entry.is_symlink():
                    found.append(name)
                elif entry.is_dir(follow_symlinks=False):
                    waiting.append(name)
    return tuple(sorted(found))
