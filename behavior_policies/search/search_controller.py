"""The controller of `search`: search apart, tell what was found, meet there.

Each robot decides where to go from its memory and from messages, which hold where the sender is,
and which victim it knows, or that it knows none. It lists the victims that it and the senders know,
but those seen to be rescued or given up, in the order of the robots, and assigns to each the
nearest robots among itself and the senders. If it is assigned, it goes there; after `PATIENCE_TIME`
it gives the victim up for `GIVEN_UP_TIME`. Otherwise it goes to the nearest square that it has not
looked at, nor the senders from where they were, and of which no sender is nearer; else to the
nearest. When none is left, it begins anew. Robots without notes never give up, and search the
squares that they observe. `heard`: [N, N, 5] columns `MASK` to `VICTIM_Y`; a robot's own row says
where it is. Without messages of payload `pose_and_goal`, two meet at a victim by chance only.
"""

from typing import NamedTuple

import numpy as np

from swarmdata.behavior_policies.heard_goals import (
    HEARD_X,
    HEARD_Y,
    MASK,
    TARGET_X,
    TARGET_Y,
    HeardGoals,
)
from swarmdata.behavior_policies.scripted import Scripted
from swarmdata.envs.search.floor_memory import RESCUED, Columns, find_unsearched, knows_victim
from swarmdata.envs.search.search import NEAREST_SQUARES, Search
from swarmdata.envs.search.search_rules import SearchRules
from swarmdata.numerics.sight import sees
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.state_layout import N_COLUMNS
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Bool, Double, Float, Int, Step

PATIENCE_TIME = 12.0  # seconds that a robot waits at a victim
GIVEN_UP_TIME = 15.0  # seconds after which a robot returns to a victim that it gave up
SAME_PLACE_DISTANCE = 0.15  # m below which two victims that robots tell of are the same
VICTIM_X, VICTIM_Y = TARGET_X, TARGET_Y  # which victim it knew, or the base

NO_INDEX = -1


class Floor(NamedTuple):
    """Constants of the task."""

    columns: Columns  # of the states
    middles: Double  # [C, 2] m, of the squares
    half: Double  # [2] m, half width and half height of the arena
    sight_range: float  # m
    goal_radius: float  # m
    helpers: int  # robots that a victim needs
    patience: int  # control steps
    given_up: int  # control steps
    takes_notes: bool  # otherwise robots know only what they observe


class Notes(NamedTuple):
    """What the robots of one episode keep in mind, besides their memory in the state."""

    looked_at: Bool  # [N, C] squares
    is_closed: Bool  # [C] squares whose middle no robot can reach
    goal_squares: Int  # [N] square that the robot searches next, or NO_INDEX
    arrivals: Int  # [N] control step since which the robot has been at its victim, or NO_INDEX
    returns: Int  # [N, K] control step before which a victim is given up


@kernel
def look_around(i: int, heard: Double, layout: Float, floor: Floor, notes: Notes) -> None:
    """Notes the squares that robot i sees, and those that the senders see from where they are."""
    for j in range(heard.shape[1]):
        if heard[i, j, MASK] == 0.0:
            continue
        x, y = heard[i, j, HEARD_X], heard[i, j, HEARD_Y]
        for c in range(floor.middles.shape[0]):
            if not notes.looked_at[i, c]:
                notes.looked_at[i, c] = sees(
                    x, y, floor.middles[c, 0], floor.middles[c, 1], floor.sight_range, layout
                )
    if notes.looked_at[i].all():
        notes.looked_at[i] = notes.is_closed
        notes.goal_squares[i] = NO_INDEX


@kernel
def nearest_known(i: int, state: Float, time: int, floor: Floor, notes: Notes) -> int:
    """The nearest victim that robot i knows and has not given up; `NO_INDEX` if there is none."""
    best, least, columns = NO_INDEX, np.inf, floor.columns
    for k in range(columns.n_victims):
        if not knows_victim(state, i, k, columns) or time < notes.returns[i, k]:
            continue
        at = columns.victims + 2 * k
        dx = float(state[at]) - float(state[N_COLUMNS * i])
        dy = float(state[at + 1]) - float(state[N_COLUMNS * i + 1])
        if dx * dx + dy * dy < least:
            best, least = k, dx * dx + dy * dy
    return best


@kernel
def is_dismissed(
    i: int, x: float, y: float, state: Float, time: int, floor: Floor, notes: Notes
) -> bool:
    """Whether robot i knows that a victim it is told of is rescued, or has given it up."""
    columns = floor.columns
    for k in range(columns.n_victims):
        at = columns.victims + 2 * k
        dx, dy = float(state[at]) - x, float(state[at + 1]) - y
        if dx * dx + dy * dy > SAME_PLACE_DISTANCE * SAME_PLACE_DISTANCE:
            continue
        is_rescued = state[columns.known + columns.n_victims * i + k] == RESCUED
        if is_rescued or time < notes.returns[i, k]:
            return True
    return False


@kernel
def list_victims(
    i: int,
    own: int,  # the victim that it knows itself, or `NO_INDEX`
    state: Float,  # [S]
    heard: Double,  # [N, N, 5]; a robot's own row says where it is
    time: int,  # control step
    floor: Floor,  # constants
    notes: Notes,  # of the robots
    out: Double,  # [N, 2] written, m
) -> int:
    """Writes the places of victims that robot i knows or is told of; returns how many."""
    count = 0
    for j in range(heard.shape[1]):
        if heard[i, j, MASK] == 0.0 or (j == i and own < 0):
            continue
        x, y = heard[i, j, VICTIM_X], heard[i, j, VICTIM_Y]
        if j == i:
            at = floor.columns.victims + 2 * own
            x, y = float(state[at]), float(state[at + 1])
        else:
            to_base = max(abs(x + floor.half[0]), abs(y + floor.half[1]))
            if to_base < SAME_PLACE_DISTANCE or is_dismissed(i, x, y, state, time, floor, notes):
                continue
        is_new = True
        for v in range(count):
            dx, dy = out[v, 0] - x, out[v, 1] - y
            if dx * dx + dy * dy < SAME_PLACE_DISTANCE * SAME_PLACE_DISTANCE:
                is_new = False
        if is_new:
            out[count, 0], out[count, 1] = x, y
            count += 1
    return count


@kernel
def assigned_victim(i: int, victims: Double, heard: Double, helpers: int) -> int:
    """Which of the victims [V, 2] (m), in order, robot i assigns itself to, or `NO_INDEX`."""
    is_free = heard[i, :, MASK] > 0.0
    for v in range(victims.shape[0]):
        for _ in range(helpers):
            best, least = NO_INDEX, np.inf
            for j in range(heard.shape[1]):
                dx, dy = heard[i, j, HEARD_X] - victims[v, 0], heard[i, j, HEARD_Y] - victims[v, 1]
                if is_free[j] and dx * dx + dy * dy < least:
                    best, least = j, dx * dx + dy * dy
            if best == i:
                return v
            if best >= 0:
                is_free[best] = False
    return NO_INDEX


@kernel
def square_distance(j: int, c: int, i: int, heard: Double, floor: Floor) -> float:
    """Square of the distance from robot j, as robot i knows it, to the middle of square c, m^2."""
    dx = floor.middles[c, 0] - heard[i, j, HEARD_X]
    dy = floor.middles[c, 1] - heard[i, j, HEARD_Y]
    return float(dx * dx + dy * dy)


@kernel
def is_mine(c: int, i: int, heard: Double, floor: Floor) -> bool:
    """Whether no sender is nearer to square c than robot i."""
    own = square_distance(i, c, i, heard, floor)
    for j in range(heard.shape[1]):
        if heard[i, j, MASK] > 0.0 and square_distance(j, c, i, heard, floor) < own:
            return False
    return True


@kernel
def next_square(i: int, heard: Double, floor: Floor, notes: Notes) -> int:
    """The square that robot i looks at next, of those that it has not looked at."""
    best, least, near, nearest = NO_INDEX, np.inf, NO_INDEX, np.inf
    for c in range(floor.middles.shape[0]):
        if notes.looked_at[i, c] or notes.is_closed[c]:
            continue
        own = square_distance(i, c, i, heard, floor)
        if own < nearest:
            near, nearest = c, own
        if own < least and is_mine(c, i, heard, floor):
            best, least = c, own
    return best if best >= 0 else near


@kernel
def observed_square(i: int, state: Float, heard: Double, floor: Floor) -> int:
    """The square that robot i looks at next, of those that it observes; `NO_INDEX` without any."""
    x, y = heard[i, i, HEARD_X], heard[i, i, HEARD_Y]
    squares = np.empty(NEAREST_SQUARES, np.int64)
    count = find_unsearched(state, i, x, y, floor.middles, floor.columns, squares)
    for c in squares[:count]:
        if is_mine(c, i, heard, floor):
            return int(c)
    return int(squares[0]) if count > 0 else NO_INDEX


@kernel
def choose_square(i: int, state: Float, heard: Double, floor: Floor, notes: Notes) -> int:
    """The square that robot i searches; `NO_INDEX` if nothing is left."""
    if not floor.takes_notes:
        return observed_square(i, state, heard, floor)
    c = notes.goal_squares[i]
    if c < 0 or notes.looked_at[i, c]:
        c = next_square(i, heard, floor, notes)
        notes.goal_squares[i] = c
    return int(c)


@kernel
def has_waited(i: int, own: int, state: Float, time: int, floor: Floor, notes: Notes) -> bool:
    """Whether robot i has been at its own victim for too long; keeps when it came there."""
    at = floor.columns.victims + 2 * own
    dx = float(state[at]) - float(state[N_COLUMNS * i])
    dy = float(state[at + 1]) - float(state[N_COLUMNS * i + 1])
    if dx * dx + dy * dy > floor.goal_radius * floor.goal_radius:
        notes.arrivals[i] = NO_INDEX
        return False
    if notes.arrivals[i] < 0:
        notes.arrivals[i] = time
    if time - notes.arrivals[i] < floor.patience:
        return False
    notes.arrivals[i] = NO_INDEX
    notes.returns[i, own] = time + floor.given_up
    return True


@kernel
def choose_goals(
    state: Float, heard: Double, layout: Float, time: int, floor: Floor, notes: Notes, goals: Double
) -> None:
    """Writes where each robot of one episode goes, m, [N, 2].

    `state` is [S], `heard` [N, N, 5], `layout` [M, 8], and `time` the control step.
    """
    n = heard.shape[0]
    victims = np.empty((n, 2))
    for i in range(n):
        if floor.takes_notes:
            look_around(i, heard, layout, floor, notes)
        own = nearest_known(i, state, time, floor, notes)
        if floor.takes_notes and own >= 0 and has_waited(i, own, state, time, floor, notes):
            own = nearest_known(i, state, time, floor, notes)
        count = list_victims(i, own, state, heard, time, floor, notes, victims)
        v = assigned_victim(i, victims[:count], heard, floor.helpers)
        if v >= 0:
            goals[i, 0], goals[i, 1] = victims[v, 0], victims[v, 1]
            continue
        c = choose_square(i, state, heard, floor, notes)
        goals[i, 0], goals[i, 1] = heard[i, i, HEARD_X], heard[i, i, HEARD_Y]
        if c >= 0:
            goals[i, 0], goals[i, 1] = floor.middles[c, 0], floor.middles[c, 1]


@kernel
def choose_all(
    states: Float,
    heard: Double,  # [E, N, N, 5]
    layouts: Float,
    times: Int,
    floor: Floor,
    notes: Notes,
    goals: Double,  # [E, N, 2] written, m
) -> None:
    """Writes where the robots of all copies go, as `choose_goals` does for one."""
    for b in range(states.shape[0]):
        own = Notes(
            notes.looked_at[b], notes.is_closed[b], notes.goal_squares[b], notes.arrivals[b],
            notes.returns[b],
        )  # fmt: skip
        choose_goals(states[b], heard[b], layouts[b], times[b], floor, own, goals[b])


class SearchController(Scripted):
    """Searches, tells, and rescues together.

    It knows the map. Each robot knows its own position and what it has seen itself (`step.states`);
    of the others, what their messages say (`step.observations`); it avoids those that are near.

    Args:
        spec: the task; its robots may differ from each other in every way.
        noise: standard deviation of the Gaussian noise on each command.
        remembers: otherwise robots take no notes: they decide from what they observe at the time,
            as actors without a memory do, which can clone them.

    Raises:
        SpecError: `noise` is not a standard deviation, the spec is another task's, or the arena is
            too large to be mapped.
    """

    def __init__(self, spec: TaskSpec, *, noise: float = 0.0, remembers: bool = True) -> None:
        rules, task = spec.rules_as(SearchRules), Search(spec)
        super().__init__(spec, noise=noise)
        self._n_agents, self._heard = spec.n_agents, HeardGoals(task)
        dt = spec.control_dt
        self._floor = Floor(
            task.columns, task.middles, np.array(spec.half_size), rules.sight_range,
            rules.goal_radius, rules.helpers, round(PATIENCE_TIME / dt), round(GIVEN_UP_TIME / dt),
            remembers,
        )  # fmt: skip
        self._notes = self._blank(0)

    def reset(self, step: Step, copies: Int) -> None:
        super().reset(step, copies)
        if len(step.seeds) != len(self._notes.looked_at):
            self._notes = self._blank(len(step.seeds))
        columns, notes = self._floor.columns, self._notes
        searched = step.states[copies, columns.searched :]
        closed = searched.reshape(len(copies), self._n_agents, columns.n_cells) > 0.0
        notes.looked_at[copies] = closed
        notes.is_closed[copies] = closed.all(1)
        notes.goal_squares[copies] = notes.arrivals[copies] = NO_INDEX
        notes.returns[copies] = 0

    def commands(self, step: Step) -> Double:
        goals: Double = np.empty((len(step.seeds), self._n_agents, 2))
        heard = self._heard.of(step)
        choose_all(step.states, heard, step.layouts, step.times, self._floor, self._notes, goals)
        return self._navigator.commands(step, goals)

    def _blank(self, n_copies: int) -> Notes:
        n, columns = self._n_agents, self._floor.columns
        looked_at: Bool = np.zeros((n_copies, n, columns.n_cells), dtype=np.bool_)
        return Notes(
            looked_at=looked_at,
            is_closed=np.zeros((n_copies, columns.n_cells), dtype=np.bool_),
            goal_squares=np.full((n_copies, n), NO_INDEX, dtype=np.int64),
            arrivals=np.full((n_copies, n), NO_INDEX, dtype=np.int64),
            returns=np.zeros((n_copies, n, columns.n_victims), dtype=np.int64),
        )
