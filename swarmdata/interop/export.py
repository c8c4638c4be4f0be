"""Converts a dataset, or a view of one, to a foreign format."""

import warnings
from pathlib import Path

from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import ConversionError
from swarmdata.interop.conversion.framed_export import in_frame
from swarmdata.interop.conversion.user_paths import absolute_path
from swarmdata.interop.formats import find_format
from swarmdata.runtime.atomic import remove_leftovers, staged


class MisplacedExportWarning(UserWarning):
    """The format's own library does not find the export where it was written."""


def export_dataset(
    dataset: Dataset, path: Path | str, *, format: str, frame: str = "world"
) -> Path:
    """Converts a view of a dataset, and returns the absolute path of the result.

    The result is written beside `path` and renamed, so it is never incomplete; leftovers of a
    killed conversion are removed. docs/formats.md lists what each format loses.

    Args:
        dataset: a dataset, or a view by `filter` or `split`.
        path: file or folder to write; may be relative, and begin with `~`.
        format: name of a format, such as `d4rl`.
        frame: of observations and actions: `target` turns them as algorithms of this library see
            them, `world` leaves them as they were recorded; or another observed vector, such as
            `payload_goal`. What a frame adds comes after an observation's own numbers.

    Raises:
        UnknownNameError: there is no such format.
        SpecError: the dataset cannot have such a frame.
        ConversionError: `path` exists, the view is empty, or the format cannot hold it.
        MissingExtraError: the format's library is not installed.
        DiskFullError: no space was left.
    """
    path, found = absolute_path(path), find_format(format)
    remove_leftovers(path.parent, path.name)
    if path.exists():
        raise ConversionError(f"{path} exists already. Choose another path, or move it away.")
    if not len(dataset):
        raise ConversionError(f"{dataset!r} has no episodes, so there is nothing to convert")
    turned = in_frame(dataset, frame)
    with staged(path) as target:
        found.write(turned, target, frame)
    if found.misplaced is not None and (problem := found.misplaced(dataset, path)):
        warnings.warn(f"{problem}.", MisplacedExportWarning, stacklevel=2)
    return path
