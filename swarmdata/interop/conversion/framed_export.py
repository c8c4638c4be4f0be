"""A dataset with observations and actions in the frame that the algorithms of this library see."""

from dataclasses import replace

import numpy as np

from swarmdata.datasets.dataset import Dataset
from swarmdata.rollouts.task_frame import frame_of
from swarmdata.runtime.mapped_pages import MappedReads
from swarmdata.store.arrays.scratch_arrays import new_arrays


def in_frame(dataset: Dataset, anchor: str) -> Dataset:
    """Returns the episodes of a view with observations and actions turned, all others as zeros.

    They are those of `learn.training.framed_dataset`: after the observation's own numbers come the
    numbers that the frame adds, `Frame.names`. States, messages and layouts stay in the world's
    frame. Large new arrays are in files without a name, as those of `Dataset.reobserve` are.

    Args:
        dataset: to turn.
        anchor: of the frame, as `frames.find_frame` takes it; `world` changes nothing.

    Raises:
        SpecError: the dataset cannot have such a frame.
        DiskFullError: the new arrays are large, and no space is left.
    """
    frame = frame_of(dataset.spec, anchor)
    if frame is None:
        return dataset
    stored, arrays = dataset.stored, dataset.stored.arrays
    shape, kept = arrays["observations"].shape, arrays["actions"]
    new = new_arrays(
        {
            "observations": ((*shape[:-1], shape[-1] + frame.n_added), np.dtype(np.float32)),
            "actions": (kept.shape, kept.dtype),
        }
    )
    everything = np.arange(len(stored.table))
    turned = replace(dataset, stored=replace(stored, arrays={**arrays, **new}))
    recorded, written = (
        replace(dataset, selection=everything),
        replace(turned, selection=everything),
    )
    chosen = np.isin(everything, dataset.selection).tolist()
    reads = MappedReads((arrays["observations"], kept, *new.values()))
    for source, target, is_chosen in zip(recorded, written, chosen, strict=True):
        inputs, actions = source.observations, source.actions
        target.observations[...] = frame.inputs(inputs) if is_chosen else 0
        target.actions[...] = frame.recorded(inputs[:-1], actions) if is_chosen else 0
        reads.add(inputs, actions, target.observations, target.actions)
    reads.release()
    return turned
