"""A dataset with observations and actions in the frame that the algorithms of this library see."""

from dataclasses import replace

import numpy as np

from swarmdata.datasets.dataset import Dataset
from swarmdata.rollouts.task_frame import frame_of


def in_frame(dataset: Dataset, anchor: str) -> Dataset:
    """Returns the episodes of a view with observations and actions turned, all others as zeros.

    They are those of `learn.training.framed_dataset`: after the observation's own numbers come the
    numbers that the frame adds, `Frame.names`. States, messages and layouts stay in the world's
    frame. The new arrays are held in memory, as those of `Dataset.reobserve` are.

    Args:
        dataset: to turn.
        anchor: of the frame, as `frames.find_frame` takes it; `world` changes nothing.

    Raises:
        SpecError: the dataset cannot have such a frame.
    """
    frame = frame_of(dataset.spec, anchor)
    if frame is None:
        return dataset
    arrays = dict(dataset.stored.arrays)
    shape = arrays["observations"].shape
    observations = np.zeros((*shape[:-1], shape[-1] + frame.n_added), np.float32)
    actions = np.zeros_like(arrays["actions"])
    turned = replace(
        dataset,
        stored=replace(
            dataset.stored, arrays={**arrays, "observations": observations, "actions": actions}
        ),
    )
    for source, target in zip(dataset, turned, strict=True):
        target.observations[...] = frame.inputs(source.observations)
        target.actions[...] = frame.recorded(source.observations[:-1], source.actions)
    return turned
