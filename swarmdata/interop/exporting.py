"""Writes a dataset, or a view of one, in a foreign format."""

import shutil
from pathlib import Path

from swarmdata.dataset import Dataset
from swarmdata.errors import ConversionError
from swarmdata.interop.formats import FORMATS, find_format
from swarmdata.store.atomic import sync, sync_tree, temporary_sibling


def export_dataset(dataset: Dataset, path: Path | str, *, format: str) -> Path:
    """Converts a view of a dataset, and returns `path`.

    What appears at `path` is whole: it is written beside it and renamed. What the format cannot
    hold is in its `lost` table.

    Args:
        dataset: all episodes, or those of `filter` or `split`, in their order.
        path: file or folder to make.
        format: one of `formats.FORMATS`.

    Raises:
        UnknownNameError: no such format.
        ConversionError: the format is only read, `path` is taken, or the view is empty or has what
            the format cannot hold.
        MissingExtraError: the format's library is not installed.
    """
    path, found = Path(path), find_format(format)
    if found.write is None:
        written = [name for name in sorted(FORMATS) if find_format(name).write is not None]
        raise ConversionError(
            f"{found.title} can only be read, got format={format!r}. Formats to write: "
            f"{', '.join(written)}."
        )
    if path.exists():
        raise ConversionError(f"{path} exists already. Delete it or choose another path.")
    if not len(dataset):
        raise ConversionError(f"{dataset!r} has no episodes, so there is nothing to convert")
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = temporary_sibling(path)
    try:
        found.write(dataset, temporary)
        if temporary.is_dir():
            sync_tree(temporary)
        else:
            sync(temporary)
        temporary.rename(path)
    finally:
        if temporary.is_dir():
            shutil.rmtree(temporary)
        else:
            temporary.unlink(missing_ok=True)
    sync(path.parent)
    return path
