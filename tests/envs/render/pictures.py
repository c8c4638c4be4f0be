"""A small scene of two robots, and what is looked at in its pictures."""

import itertools

import numpy as np

from swarmdata.envs.render import ROBOT_COLORS, Image
from swarmdata.specs.task_spec import Role, TaskSpec
from swarmdata.types import Float

SPEC = TaskSpec(team=(Role(count=2),), horizon=20)
EMPTY = np.zeros((0, 8), np.float32)
LEFT, RIGHT = ROBOT_COLORS[:2]


def state_of(*rows: tuple[float, ...], extras: tuple[float, ...] = ()) -> Float:
    """A state of robots x, y, vx, vy, ux, uy, tx, ty and what follows them."""
    return np.array([*itertools.chain(*rows), *extras], np.float32)


# robot 0 at (-1, 1) drives right to a far goal; robot 1 stands in its goal at (1, 1)
STATE = state_of((-1, 1, 0.5, 0, 1, 0, -1, -1), (1, 1, 0, 0, 1, 0, 1, 1))


def pixel(image: Image, x: float, y: float) -> tuple[int, ...]:
    """Color at a place given in metres, for the default 4 m arena with 0.1 m of wall."""
    scale = image.shape[1] / 4.2
    return tuple(image[int((2.1 - y) * scale), int((x + 2.1) * scale)].tolist())


def n_near(image: Image, color: tuple[int, ...], tolerance: int = 12) -> int:
    """Number of pixels of about that color."""
    return int((np.abs(image.astype(int) - color).max(axis=-1) <= tolerance).sum())
