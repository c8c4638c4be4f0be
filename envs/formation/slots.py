"""The slots of a formation: their positions, their assignment to robots, and their velocities.

These kernels work on one row of the states: robots, then the extras that `formation` describes,
where the reference comes first and the control points of its path last.
"""

from swarmdata.envs.formation.reference_path import write_motion, write_pose
from swarmdata.numerics.assignment import assign
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.state_layout import N_COLUMNS, TX, TY, X, Y
from swarmdata.types import Double, Float, Int

HELD, PREVIEW = 7, 8  # offsets, after the robots, of steps in formation and previews

Course = tuple[Double, bool, float, float, Double]
"""The motion of reference and slots: slots in the reference's frame, m, [N, 2]; whether they are
assigned; segments of the path per control step; segments per second; segments from now to each
preview, [P]. A plain tuple, since named ones are slower to pass."""

Scratch = tuple[Double, Double, Double, Int]
"""Memory to overwrite: slots, m, [N, 2]; costs, [N, N]; the two arrays of `assignment.assign`."""


@kernel
def _are_nearest(costs: Double, places: Int) -> bool:
    """Gives every robot its cheapest slot; returns False if two robots share one."""
    n = costs.shape[0]
    for i in range(n):
        best = 0
        for j in range(1, n):
            if costs[i, j] < costs[i, best]:
                best = j
        for k in range(i):
            if places[0, k] == best:
                return False
        places[0, i] = best
    return True


@kernel
def place_slots(state: Float, course: Course, scratch: Scratch) -> None:
    """Writes the targets of one state [S] from its robots and its reference."""
    offsets, is_assigned, _, _, _ = course
    slots, costs, work, places = scratch
    n = offsets.shape[0]
    at = N_COLUMNS * n
    x, y = float(state[at]), float(state[at + 1])
    ux, uy = float(state[at + 4]), float(state[at + 5])
    for j in range(n):
        slots[j, 0] = x + ux * offsets[j, 0] - uy * offsets[j, 1]
        slots[j, 1] = y + uy * offsets[j, 0] + ux * offsets[j, 1]
        places[0, j] = j
    if is_assigned:
        for i in range(n):
            px, py = float(state[N_COLUMNS * i + X]), float(state[N_COLUMNS * i + Y])
            for j in range(n):
                dx, dy = slots[j, 0] - px, slots[j, 1] - py
                costs[i, j] = dx * dx + dy * dy
        if not _are_nearest(costs, places):  # usually they are, which is much faster
            assign(costs, work, places)
    for i in range(n):
        state[N_COLUMNS * i + TX] = slots[places[0, i], 0]
        state[N_COLUMNS * i + TY] = slots[places[0, i], 1]


@kernel
def place_reference(state: Float, time: int, course: Course, scratch: Scratch) -> None:
    """Writes the reference of control step `time`, its previews and the targets of one state."""
    offsets, _, per_step, rate, ahead = course
    at = N_COLUMNS * offsets.shape[0]
    first, s = at + PREVIEW + 4 * ahead.shape[0], time * per_step
    write_motion(state, first, s, rate, state, at)
    for k in range(ahead.shape[0]):
        write_pose(state, first, s + ahead[k], state, at + PREVIEW + 4 * k)
    place_slots(state, course, scratch)


@kernel
def begin_episodes(copies: Int, states: Float, course: Course, scratch: Scratch) -> None:
    """Writes reference, previews and targets of the rows `copies` [k] of states [E, S]."""
    for b in copies:
        states[b, N_COLUMNS * course[0].shape[0] + HELD] = 0.0
        place_reference(states[b], 0, course, scratch)


@kernel
def slot_velocity(state: Float, n: int, i: int) -> tuple[float, float]:
    """Velocity of robot i's slot in a state [S] of n robots, m/s."""
    at = N_COLUMNS * n
    turn = float(state[at + 6])
    x = float(state[N_COLUMNS * i + TX]) - float(state[at])
    y = float(state[N_COLUMNS * i + TY]) - float(state[at + 1])
    return float(state[at + 2]) - turn * y, float(state[at + 3]) + turn * x
