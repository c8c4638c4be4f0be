"""Converts a dataset, or a view of one, to a foreign format."""

from pathlib import Path

from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import ConversionError
from swarmdata.interop.formats import FORMATS, find_format
from swarmdata.runtime.atomic import remove_leftovers, staged


def export_dataset(dataset: Dataset, path: Path | str, *, format: str) -> Path:
    """Converts a view of a dataset, and returns the absolute path of the result.

    The result is written beside `path` and renamed, so it is never incomplete; leftovers of a
    killed conversion are removed. docs/formats.md lists what each format loses.

    Args:
        dataset: a dataset, or a view by `filter` or `split`.
        path: file or folder to write; may be relative, and begin with `~`.
        format: name of a format, such as `d4rl`.

    Raises:
        UnknownNameError: there is no such format.
        ConversionError: the format can only be read, `path` exists, the view is empty, or the
            format cannot hold it.
        MissingExtraError: the format's library is not installed.
        DiskFullError: no space was left.
    """
    path, found = Path(path).expanduser().absolute(), find_format(format)
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
