"""Converts a dataset, or a subset of one, to a foreign format."""

import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np

from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import ConversionError, check_type
from swarmdata.interop.conversion.user_choices import absolute_path
from swarmdata.interop.formats import find_format
from swarmdata.rollouts.function_policy import frame_of
from swarmdata.runtime.atomic import staged
from swarmdata.runtime.mapped_pages import MappedReads
from swarmdata.store.arrays.scratch_arrays import new_arrays


class MisplacedExportWarning(UserWarning):
    """The format's own library does not find the export where it was written."""


def export_dataset(
    dataset: Dataset, path: Path | str, *, format: str, frame: str = "world"
) -> Path:
    """Converts a dataset or a subset of it, and returns the absolute path of the result.

    The result is written beside `path` and renamed, so it is never incomplete; leftovers of a
    killed conversion are removed. docs/your-data.md lists what each format loses.

    Args:
        dataset: a dataset, or a subset by `filter` or `split`.
        path: file or folder to write; may be relative, and begin with `~`.
        format: name of a format, such as `d4rl`.
        frame: of observations and actions: `target` turns them as algorithms of this library see
            them, `world` leaves them as they were recorded; or another observed vector, such as
            `payload_goal`. What a frame adds comes after an observation's own numbers.

    Raises:
        UnknownNameError: there is no such format.
        SpecError: the dataset cannot have such a frame.
        ConversionError: `path` exists, the subset is empty, or the format cannot hold it.
        MissingExtraError: the format's library is not installed.
        DiskFullError: no space was left.
    """
    check_type("the dataset", dataset, Dataset, "a Dataset", "Of a mixture, convert its parts.")
    path, found = absolute_path(path), find_format(format)
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


def in_frame(dataset: Dataset, anchor: str) -> Dataset:
    """Returns the episodes of a subset with observations and actions turned, all others as zeros.

    After an observation's own numbers come those that the frame adds, as in
    `learn.training.training_data`. States, messages and layouts stay in the world's frame. Large
    new arrays are in files without a name, as those of `Dataset.reobserve` are.
    """
    frame = frame_of(dataset.spec, anchor)
    if frame is None:
        return dataset
    stored, arrays = dataset.stored, dataset.stored.arrays
    shape, kept = arrays["observations"].shape, arrays["actions"]
    wider = ((*shape[:-1], shape[-1] + frame.n_added), np.dtype(np.float32))
    new = new_arrays({"observations": wider, "actions": (kept.shape, kept.dtype)})
    everything = np.arange(len(stored.table))
    turned = replace(dataset, stored=replace(stored, arrays={**arrays, **new}))
    recorded, written = (replace(each, selection=everything) for each in (dataset, turned))
    chosen = np.isin(everything, dataset.selection).tolist()
    reads = MappedReads((arrays["observations"], kept, *new.values()))
    for source, target, is_chosen in zip(recorded, written, chosen, strict=True):
        inputs, actions = source.observations, source.actions
        target.observations[...] = frame.inputs(inputs) if is_chosen else 0
        target.actions[...] = frame.recorded(inputs[:-1], actions) if is_chosen else 0
        reads.add(inputs, actions, target.observations, target.actions)
    reads.release()
    return turned
