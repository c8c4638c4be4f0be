"""Names of files, models and tasks as JSON values that mean the same in any process."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from swarmdata.hub.remotes.outside_names import is_folder
from swarmdata.specs.frozen import Frozen, is_file, is_inline
from swarmdata.specs.model_choice import Source


def portable_name(name: str | Path) -> str:
    """Returns the absolute path of a folder that is there, and any other name as it is.

    Args:
        name: of a policy, a tier, a dataset or a folder.
    """
    return str(Path(name).resolve()) if is_folder(name) else str(name)


def portable_source(source: Source | None) -> Any:
    """Returns a model, a spec or a file of one as JSON.

    Args:
        source: a model, its fields, the text of one, a name, or a file, whose path becomes
            absolute.
    """
    if isinstance(source, Frozen):
        return source.model_dump(mode="json")
    if isinstance(source, Mapping):
        return dict(source)
    if source is None or (isinstance(source, str) and is_inline(source)) or not is_file(source):
        return source
    return str(Path(source).resolve())
