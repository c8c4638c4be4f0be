"""What each robot remembers: the victims that it has seen, and the squares that it has searched.

The arena is divided into squares of `rules.cell_size`, the last ones of a row or column cut off by
the wall. A robot sees a point within `rules.sight_range` of its centre that no obstacle hides
(`numerics.sight`). It has searched a square once it has seen its middle; squares whose middle is
too close to an obstacle for a robot count as searched from the start. Of a victim it remembers
whether it was rescued when it last saw it. `middles` [C, 2] are those of the squares, m.
"""

import math
from typing import NamedTuple, Self

import numpy as np

from swarmdata.envs.search.search_rules import SearchRules
from swarmdata.numerics.geometry import clearance
from swarmdata.numerics.sight import sees
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.state_layout import N_COLUMNS
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Double, Float, Int

MIDDLE_CLEARANCE = 0.06  # m to obstacles that a robot in the middle of a square needs to count it
UNSEEN, WAITING, RESCUED = range(3)  # what a robot knows of a victim


class Columns(NamedTuple):
    """First columns of the task's own numbers in a state, and how many there are."""

    n_agents: int
    n_victims: int  # K
    n_cells: int  # C
    victims: int  # x and y of each victim, [K, 2]
    rescued: int  # 0 or 1 for each victim, [K]
    known: int  # `UNSEEN`, `WAITING` or `RESCUED` for each robot and victim, [N, K]
    searched: int  # 0 or 1 for each robot and square, [N, C]

    @classmethod
    def of(cls, n_agents: int, n_victims: int, n_cells: int) -> Self:
        first = N_COLUMNS * n_agents
        rescued = first + 2 * n_victims
        known = rescued + n_victims
        searched = known + n_agents * n_victims
        return cls(n_agents, n_victims, n_cells, first, rescued, known, searched)


def cell_middles(spec: TaskSpec, rules: SearchRules) -> Double:
    """Middles of all squares, row by row from below, m, [C, 2]."""
    axes = []
    for size in (spec.arena.width, spec.arena.height):
        n = math.ceil(size / rules.cell_size - 1e-9)
        low = rules.cell_size * np.arange(n)
        high = np.minimum(low + rules.cell_size, size)
        axes.append((low + high) / 2 - size / 2)
    x, y = np.meshgrid(*axes)
    return np.stack([x, y], axis=-1).reshape(-1, 2)


def search_definitions(spec: TaskSpec, rules: SearchRules) -> dict[str, str]:
    """What robots see and remember, for readers of a dataset, by name."""
    n_columns = math.ceil(spec.arena.width / rules.cell_size - 1e-9)
    reach = max(robot.radius for robot in spec.robots) + MIDDLE_CLEARANCE
    return {
        "square c": (
            f"Squares have sides of {rules.cell_size:g} m and are laid out from the corner of the "
            "arena with the smallest x and y; the last of a row or column end at the wall. "
            f"Square c is number c mod {n_columns} along x and floor(c / {n_columns}) along y, "
            "both from 0. Its middle is that of what lies in the arena"
        ),
        "to see a point": (
            f"It is at most {rules.sight_range:g} m from the robot's centre, and the segment "
            "between them crosses no obstacle of `episodes/layouts`"
        ),
        "searched_c": (
            "1 from the first state in which the robot sees the middle of square c; 1 from the "
            f"start, for all robots, where that is less than {reach:g} m from an obstacle or wall"
        ),
        "rescued": (
            f"1 from the state of the first step after which the centres of {rules.helpers} or "
            f"more robots are at most {rules.goal_radius:g} m from the victim; 0 in the first "
            "state"
        ),
        "known_k": (
            "Set in every state, after `rescued`, if the robot sees victim k: to 2 if it is "
            "rescued, else to 1. It is 2 for ever, and 0 before the robot first sees the victim"
        ),
        "tx, ty": (
            "The nearest victim whose `known_k` of the robot is 1, the first of equally near ones; "
            f"without any the base, ({-spec.half_size[0]:g}, {-spec.half_size[1]:g})"
        ),
    }


@kernel
def knows_victim(state: Float, i: int, k: int, columns: Columns) -> bool:
    """Whether robot i has seen victim k, and not seen that it is rescued."""
    return bool(state[columns.known + columns.n_victims * i + k] == WAITING)


@kernel
def look(
    state: Float, i: int, layout: Float, middles: Double, sight_range: float, columns: Columns
) -> tuple[int, int]:
    """Adds what robot i sees to its memory; returns how many victims and squares are new to it."""
    x, y = float(state[N_COLUMNS * i]), float(state[N_COLUMNS * i + 1])
    n_sighted = n_searched = 0
    for k in range(columns.n_victims):
        at, column = columns.victims + 2 * k, columns.known + columns.n_victims * i + k
        if state[column] < RESCUED and sees(
            x, y, float(state[at]), float(state[at + 1]), sight_range, layout
        ):
            n_sighted += state[column] == UNSEEN
            state[column] = RESCUED if state[columns.rescued + k] > 0.0 else WAITING
    for c in range(columns.n_cells):
        column = columns.searched + columns.n_cells * i + c
        if state[column] == 0.0 and sees(x, y, middles[c, 0], middles[c, 1], sight_range, layout):
            state[column] = 1.0
            n_searched += 1
    return n_sighted, n_searched


@kernel
def close_cells(
    state: Float, layout: Float, middles: Double, half: Double, radius: float, columns: Columns
) -> None:
    """Counts squares whose middle no robot can reach as searched by every robot."""
    for c in range(columns.n_cells):
        free = clearance(middles[c, 0], middles[c, 1], layout, half)
        if free < radius + MIDDLE_CLEARANCE:
            for i in range(columns.n_agents):
                state[columns.searched + columns.n_cells * i + c] = 1.0


@kernel
def find_unsearched(
    state: Float, i: int, x: float, y: float, middles: Double, columns: Columns, out: Int
) -> int:
    """Writes the squares nearest to (x, y) that robot i has not searched, [K]; returns how many.

    `x`, `y`: m.
    """
    count, distances = 0, np.empty(out.shape[0])
    for c in range(columns.n_cells):
        if state[columns.searched + columns.n_cells * i + c] > 0.0:
            continue
        dx, dy = middles[c, 0] - x, middles[c, 1] - y
        distance = dx * dx + dy * dy
        if count == out.shape[0] and distance >= distances[count - 1]:
            continue
        count = min(count + 1, out.shape[0])
        slot = count - 1
        while slot > 0 and distances[slot - 1] > distance:
            out[slot], distances[slot] = out[slot - 1], distances[slot - 1]
            slot -= 1
        out[slot], distances[slot] = c, distance
    return count
