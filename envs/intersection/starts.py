"""Starts of an intersection: near the gates of all arms, in an order drawn from the seed.

The first robot of an arm starts in its entry, the second in its exit, and any others behind that,
on the side of those who drive out. Which robot is where, and which arm has one robot more, is
drawn. Each start is moved by up to `START_JITTER` along both axes; headings are drawn.
"""

from typing import NamedTuple, Self

import numpy as np

from swarmdata.envs.intersection.junction import ARM_DIRECTIONS, N_ARMS, Junction
from swarmdata.envs.world.spawn import LAYOUT_OFFSET, next_uniform, put_at_rest
from swarmdata.errors import SpecError
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.state_layout import N_COLUMNS, X, Y
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Bool, Double, Float, Int, Seeds

START_JITTER = 0.03
"""Largest distance of a start from the middle of its place, along each axis, m."""


class StartPlan(NamedTuple):
    """What starts depend on."""

    places: Double  # [4, R, 2] middle of each place in each arm, R robots at most
    radii: Double  # [N] m
    has_heading: Bool  # [N] whether a robot's heading is drawn

    @classmethod
    def of(cls, spec: TaskSpec, junction: Junction) -> Self:
        """Returns the plan of a spec.

        Raises:
            SpecError: the arms are too short for so many robots.
        """
        radii = np.array([robot.radius for robot in spec.robots])
        gap = spec.spawn.start_separation + 2 * START_JITTER
        n_rows = -(-spec.n_agents // N_ARMS)
        behind = (2 * float(radii.max()) + gap) * np.arange(1, max(n_rows - 1, 1))
        queue = junction.exits[:, None] - behind[:, None] * ARM_DIRECTIONS[:, None]
        gates = np.stack([junction.entries, junction.exits], axis=1)
        places = np.concatenate([gates, queue], axis=1)[:, :n_rows]
        innermost = (places * ARM_DIRECTIONS[:, None]).sum(-1).min()
        if innermost < junction.half_width + radii.max():
            raise SpecError(
                f"{n_rows} robots with gaps of {gap:g} m do not fit in an arm of this "
                "intersection. Use a larger arena, fewer robots, or a smaller "
                "spawn.start_separation."
            )
        has_heading = np.array([robot.dynamics == "unicycle" for robot in spec.robots])
        return cls(np.ascontiguousarray(places), radii, has_heading)


@kernel
def draw_starts(seeds: Seeds, copies: Int, plan: StartPlan, states: Float) -> None:
    """Draws where the robots of the episodes `seeds` start, at rest; the rest of a state is 0.

    Args:
        seeds: episode seeds, [len(copies)].
        copies: rows to write.
        plan: of the spec.
        states: written, [E, S].
    """
    n = plan.radii.shape[0]
    state, order = np.empty(1, np.uint64), np.empty(n, np.int64)
    for c in range(copies.shape[0]):
        row = states[copies[c]]
        row[:] = 0.0
        state[0] = seeds[c] + np.uint64(LAYOUT_OFFSET)
        first = int(N_ARMS * next_uniform(state))
        for k in range(n):  # a random order, from the inside out (Knuth's Algorithm P)
            j = int((k + 1) * next_uniform(state))
            order[k] = order[j]
            order[j] = k
        for i in range(n):
            robot = row[N_COLUMNS * i : N_COLUMNS * (i + 1)]
            place = plan.places[(order[i] + first) % N_ARMS, order[i] // N_ARMS]
            robot[X] = place[0] + START_JITTER * (2.0 * next_uniform(state) - 1.0)
            robot[Y] = place[1] + START_JITTER * (2.0 * next_uniform(state) - 1.0)
            put_at_rest(state, plan.has_heading[i], robot)
