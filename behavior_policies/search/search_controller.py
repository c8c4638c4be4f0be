"""The controller of `search`: search apart, tell what was found, meet there.

Each robot decides where to go from its memory and from messages (`search_team`); `navigator` drives
it there. Without messages of payload `pose_and_goal`, two meet at a victim by chance only.
"""

import numpy as np

from swarmdata.behavior_policies.heard_goals import HeardGoals
from swarmdata.behavior_policies.scripted import Scripted
from swarmdata.behavior_policies.search.search_team import (
    GIVEN_UP_TIME,
    NO_INDEX,
    PATIENCE_TIME,
    Floor,
    Notes,
    choose_goals,
)
from swarmdata.envs.search.search import Search
from swarmdata.envs.search.search_rules import SearchRules
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Bool, Double, Float, Int, Step


@kernel
def choose_all(
    states: Float,
    heard: Double,
    layouts: Float,
    times: Int,
    floor: Floor,
    notes: Notes,
    goals: Double,
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
        """Maps the layouts of `copies`, and forgets what their robots had in mind."""
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
