"""A reward of one's own, which other processes can import."""

import numpy as np

from swarmdata.types import Episode, Float


def effort(episode: Episode) -> Float:
    """Minus the size of each robot's action, [T, N]."""
    return -np.abs(episode.actions).sum(axis=2)
