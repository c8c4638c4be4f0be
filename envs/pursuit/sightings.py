"""What each robot knows of each evader: where it saw it last, how fast, and how long ago.

Without a `rules.sight_range`, robots see every evader all the time, and the state has no columns
for it. Otherwise a robot sees those that no obstacle hides (`numerics.sight`), and forgets one
after `MEMORY_TIME`, unless it saw that it was captured.
"""

from collections.abc import Callable
from typing import NamedTuple, Self

import numpy as np

from swarmdata.numerics.sight import sees
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.state_layout import N_COLUMNS, TX, TY, pair
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Column, Float

MEMORY_TIME = 5.0  # seconds for which a robot remembers an evader that it does not see
UNKNOWN, FREE, CAPTURED = range(3)  # what a robot knows of an evader
N_MEMORY = 6  # columns of a robot's memory of an evader: what it knows, x, y, vx, vy and age


class Columns(NamedTuple):
    """First columns of the task's own numbers in a state, and how many evaders there are."""

    n_agents: int
    n_evaders: int  # K
    places: int  # x and y of each evader, [K, 2]
    captured: int  # 0 or 1 for each evader, [K]
    velocities: int  # vx and vy of each evader, [K, 2]
    alarmed: int  # 0 or 1 for each evader, [K]
    headings: int  # ux and uy of each evader, [K, 2]
    memory: int  # of each robot and evader, [N, K, 6]; -1: robots see everything

    @classmethod
    def of(cls, n_agents: int, n_evaders: int, is_limited: bool) -> Self:
        """Returns the columns of a team and its evaders."""
        first = N_COLUMNS * n_agents
        memory = first + 8 * n_evaders if is_limited else -1
        return cls(
            n_agents, n_evaders, first, first + 2 * n_evaders, first + 3 * n_evaders,
            first + 5 * n_evaders, first + 6 * n_evaders, memory,
        )  # fmt: skip


class Sighting(NamedTuple):
    """What a robot knows of an evader."""

    status: int  # `UNKNOWN`, `FREE` or `CAPTURED`
    x: float  # m, where it saw it last
    y: float  # m
    vx: float  # m/s, how fast it was
    vy: float  # m/s
    age: float  # s since then


@kernel
def sighting(state: Float, i: int, k: int, columns: Columns) -> Sighting:
    """What robot i knows of evader k."""
    if columns.memory < 0:
        at, v = columns.places + 2 * k, columns.velocities + 2 * k
        status = CAPTURED if state[columns.captured + k] > 0.0 else FREE
        return Sighting(
            status, np.float64(state[at]), np.float64(state[at + 1]), np.float64(state[v]),
            np.float64(state[v + 1]), 0.0,
        )  # fmt: skip
    m = columns.memory + N_MEMORY * (columns.n_evaders * i + k)
    return Sighting(
        int(state[m]), np.float64(state[m + 1]), np.float64(state[m + 2]),
        np.float64(state[m + 3]), np.float64(state[m + 4]), np.float64(state[m + 5]),
    )  # fmt: skip


@kernel
def remember(
    state: Float, i: int, layout: Float, sight_range: float, dt: float, columns: Columns
) -> None:
    """Lets robot i look, and forget, after a time `dt`; nothing to do if it sees everything."""
    if columns.memory < 0:
        return
    x, y = np.float64(state[N_COLUMNS * i]), np.float64(state[N_COLUMNS * i + 1])
    for k in range(columns.n_evaders):
        at, v = columns.places + 2 * k, columns.velocities + 2 * k
        m = columns.memory + N_MEMORY * (columns.n_evaders * i + k)
        px, py = np.float64(state[at]), np.float64(state[at + 1])
        if sees(x, y, px, py, sight_range, layout):
            state[m] = CAPTURED if state[columns.captured + k] > 0.0 else FREE
            state[m + 1], state[m + 2] = state[at], state[at + 1]
            state[m + 3], state[m + 4] = state[v], state[v + 1]
            state[m + 5] = 0.0
        elif state[m] == FREE:
            state[m + 5] = np.float64(state[m + 5]) + dt
            if state[m + 5] >= MEMORY_TIME - 0.5 * dt:
                for c in range(N_MEMORY):
                    state[m + c] = 0.0


@kernel
def aim(state: Float, i: int, columns: Columns) -> bool:
    """Sets the target of robot i: the nearest free evader that it knows; whether it has one.

    Without one, its target is where it is.
    """
    r, least = N_COLUMNS * i, np.inf
    x, y = np.float64(state[r]), np.float64(state[r + 1])
    state[r + TX], state[r + TY] = state[r], state[r + 1]
    for k in range(columns.n_evaders):
        known = sighting(state, i, k, columns)
        dx, dy = known.x - x, known.y - y
        if known.status == FREE and dx * dx + dy * dy < least:
            least = dx * dx + dy * dy
            state[r + TX], state[r + TY] = known.x, known.y
    return least < np.inf


def pursuit_columns(spec: TaskSpec, columns: Columns) -> tuple[Column, ...]:
    """The task's own columns of a state, in the order of `Columns`."""
    more = "; a unit vector, kept while it flees"

    def of_all(write: Callable[[str], tuple[Column, ...]]) -> list[Column]:
        return [each for k in range(columns.n_evaders) for each in write(f"evader_{k}.")]

    def flag(name: str, meaning: str) -> tuple[Column, ...]:
        return (Column(name, meaning, low=0, high=1),)

    memory = [
        column
        for robot in spec.agent_names
        for k in range(columns.n_evaders)
        for column in _memory_columns(f"{robot}.evader_{k}_", spec)
    ]
    return (
        *of_all(lambda name: pair(name, "position of the evader", "m", spec.half_size)),
        *of_all(lambda name: flag(f"{name}captured", "1 once it is captured, else 0")),
        *of_all(lambda name: pair(f"{name}v", "velocity of the evader", "m/s", None)),
        *of_all(lambda name: flag(f"{name}alarmed", "1 while it flees, else 0")),
        *of_all(lambda n: pair(f"{n}u", "heading in which it wanders", "", (1.0, 1.0), more)),
        *(memory if columns.memory >= 0 else ()),
    )


def _memory_columns(prefix: str, spec: TaskSpec) -> tuple[Column, ...]:
    return (
        Column(
            f"{prefix}known",
            "0 if it knows no place of the evader, 1 if it does, 2 once it saw it captured",
            low=0,
            high=2,
        ),
        *pair(prefix, "place where it saw the evader last", "m", spec.half_size),
        *pair(f"{prefix}v", "velocity of the evader when it saw it last", "m/s", None),
        Column(
            f"{prefix}age", "time since then; 0 of a captured one", "s", low=0, high=MEMORY_TIME
        ),
    )
