"""Writes a dataset, or a view of one, in a foreign format."""

from pathlib import Path

from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import ConversionError
from swarmdata.interop.formats import FORMATS, find_format
from swarmdata.runtime.atomic import remove_leftovers, staged


def export_dataset(dataset: Dataset, path: Path | str, *, format: str) -> Path:
    """Converts a view of a dataset, and returns `path`.

    What appears at `path` is whole: it is written beside it and renamed, and what a conversion that
    was killed left there is removed. What the format cannot hold is in its `lost` table.

    Args:
        dataset: all episodes, or those of `filter` or `split`, in their order.
        path: file or folder to make.
        format: one of `formats.FORMATS`.

    Raises:
        UnknownNameError: no such format.
        ConversionError: the format is only read, `path` is taken, or the view is empty or has what
            the format cannot hold.
        MissingExtraError: the format's library is not installed.
        DiskFullError: no space was left.
    """
    path, found = Path(path), find_format(format)
    if found.write is None:
        written = [name for name in sorted(FORMATS) if find_format(name).write is not None]
        raise ConversionError(
            f"{found.title} can only be read, got format={format!r}. Formats to write: "
            f"{', '.join(written)}."
        )
    remove_leftovers(path.parent, path.name)
    if path.exists():
        raise ConversionError(f"{path} exists already. Delete it or choose another path.")
    if not len(dataset):
        raise ConversionError(f"{dataset!r} has no episodes, so there is nothing to convert")
    with staged(path) as target:
        found.write(dataset, target)
    return path
