"""Names of files, models and tasks as JSON values that mean the same in any process."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from swarmdata.runtime.outside_names import is_folder
from swarmdata.specs.frozen import Frozen, is_file, is_inline
from swarmdata.specs.model_choice import Source

_FOLDERS = re.compile(r"(?<![\w.:/~-])/(?:[^\s/'\"]+/)+")
"""Of an absolute path in a sentence: all but its last name. Addresses have none."""


def portable_name(name: str | Path) -> str:
    """Returns the absolute path of a folder that is there, and any other name as it is."""
    return str(Path(name).resolve()) if is_folder(name) else str(name)


def portable_source(source: Source | None) -> Any:
    """Returns a model, a spec or a file of one as JSON; the path of a file becomes absolute."""
    if isinstance(source, Frozen):
        return source.model_dump(mode="json")
    if isinstance(source, Mapping):
        return dict(source)
    if source is None or (isinstance(source, str) and is_inline(source)) or not is_file(source):
        return source
    return str(Path(source).resolve())


def without_places(value: Any) -> Any:
    """Returns a JSON value in which absolute paths are their last names, for what is published.

    Where a user keeps files says who they are, and nothing to anybody else.
    """
    if isinstance(value, str):
        return Path(value).name if Path(value).is_absolute() else value
    if isinstance(value, Mapping):
        return {without_places(key): without_places(each) for key, each in value.items()}
    return list(map(without_places, value)) if isinstance(value, list | tuple) else value


def without_folders(sentence: str) -> str:
    """Returns a sentence, such as an error's, in which absolute paths are their last names."""
    return _FOLDERS.sub("", sentence)
