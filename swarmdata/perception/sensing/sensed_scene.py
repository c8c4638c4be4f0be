"""The constants of a task that all sensors share, and the features of every body-frame model."""

import math
from typing import Annotated, NamedTuple, Self

import numpy as np

from swarmdata.interfaces import Task
from swarmdata.numerics.geometry import BOX, CIRCLE, bounding_radius
from swarmdata.runtime.argument_blocks import bundle_type
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.features import Feature, telling_goals, vector
from swarmdata.specs.state_layout import BODY, N_COLUMNS, TX, TY, UX, UY, VX, VY, X, Y
from swarmdata.types import Double, Float

N_BODY = len(BODY)

TARGET_NEAR = 0.01  # distance (m) within which a target has no bearing

_DISTANCE_MEANING = "distance of the target / diagonal of the arena"
_BEARING_MEANING = "cosine and sine of the target's bearing; (0, 0) within 1 cm of it"

POLAR_FEATURES = (
    *vector("own.v", "velocity", "own velocity"),
    *telling_goals(
        (
            Feature("target.distance", "range", "", _DISTANCE_MEANING),
            *vector("target.bearing", "direction", _BEARING_MEANING),
        )
    ),
)
"""The first features of every model in the body's frame."""

N_POLAR = len(POLAR_FEATURES)


class Scene(NamedTuple):
    """Constants of a task for the kernels of its sensor, which get an `ArgumentBlock` of them."""

    n_agents: int
    radii: Annotated[Double, 1]  # [N] m
    ranges: Annotated[Double, 1]  # [N] m, of each robot's sensors; infinite: the model's alone
    half: Annotated[Double, 1]  # [2] half width and half height of the arena, m
    diagonal: float  # of the arena, m
    bodies: Annotated[Double, 2]  # [K, 3] movable bodies: shape code, half length, half width, m
    has_headings: bool  # whether any robot is a unicycle
    n_parts: int = 0  # rays, slots of neighbours, or cells in each direction
    span: float = 0.0  # m, the model's range, or the side of a cell
    rays: Annotated[Float, 3] = np.zeros((0, 2, 0), dtype=np.float32)  # `lidar.ray_blocks`

    @classmethod
    def of(cls, task: Task) -> Self:
        robots, arena = task.spec.robots, task.spec.arena
        shapes = {"circle": CIRCLE, "box": BOX}
        bodies = [(shapes[p.shape], p.half_length, p.half_width) for p in task.movables]
        return cls(
            n_agents=len(robots),
            radii=np.array([robot.radius for robot in robots]),
            ranges=np.array(
                [np.inf if robot.sensor_range is None else robot.sensor_range for robot in robots]
            ),
            half=np.array([arena.width / 2, arena.height / 2]),
            diagonal=math.sqrt(arena.width * arena.width + arena.height * arena.height),
            bodies=np.array(bodies, dtype=np.float64).reshape(-1, 3),
            has_headings=any(robot.dynamics == "unicycle" for robot in robots),
        )


SCENE = bundle_type(Scene)


@kernel
def gather(
    state: Float,  # [S] one copy's state
    layout: Float,  # [M, 8] its obstacles
    n_agents: int,  # N
    bodies: Double,  # [K, 3], as in `Scene`
    rows: Double,  # [M + K, 8] written, columns `geometry.OBSTACLE`
    sizes: Double,  # [M + K] written, bounding radii of the rows, m
) -> None:
    """Writes the obstacles and then the movable bodies as rows of a layout."""
    n_obstacles = layout.shape[0]
    for m in range(n_obstacles):
        for c in range(8):
            rows[m, c] = layout[m, c]
    for k in range(bodies.shape[0]):
        row, at = rows[n_obstacles + k], N_COLUMNS * n_agents + N_BODY * k
        row[0] = bodies[k, 0]
        row[1] = state[at]
        row[2] = state[at + 1]
        row[3] = state[at + 4]
        row[4] = state[at + 5]
        row[5] = bodies[k, 1]
        row[6] = bodies[k, 2]
        row[7] = 0.0
    for m in range(rows.shape[0]):
        sizes[m] = bounding_radius(rows[m])


@kernel
def write_polar(out: Float, state: Float, i: int, diagonal: float) -> None:
    """Writes `POLAR_FEATURES` of robot i of a state [S] into out[:5]; the arena's diagonal in m."""
    at = N_COLUMNS * i
    ux, uy = float(state[at + UX]), float(state[at + UY])
    vx, vy = float(state[at + VX]), float(state[at + VY])
    dx = float(state[at + TX]) - float(state[at + X])
    dy = float(state[at + TY]) - float(state[at + Y])
    distance = math.sqrt(dx * dx + dy * dy)
    scale = 0.0 if distance < TARGET_NEAR else 1.0 / distance
    out[0] = ux * vx + uy * vy
    out[1] = ux * vy - uy * vx
    out[2] = min(distance / diagonal, 1.0)
    out[3] = (ux * dx + uy * dy) * scale
    out[4] = (ux * dy - uy * dx) * scale
