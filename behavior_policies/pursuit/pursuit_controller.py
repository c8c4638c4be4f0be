"""The controller of `pursuit`: surround the evader from afar, and close in together.

Each robot decides from what it believes (`beliefs`) who surrounds which evader (`groups`), and
where to drive (`ring`); `navigator` drives it there.
"""

from typing import ClassVar

import numpy as np

from swarmdata.behavior_policies.heard_goals import HeardGoals
from swarmdata.behavior_policies.pursuit.beliefs import Beliefs, Hunt, blank_beliefs, update_beliefs
from swarmdata.behavior_policies.pursuit.groups import Plans, blank_plans, choose_goals
from swarmdata.behavior_policies.pursuit.ring import N_DIRECTIONS
from swarmdata.behavior_policies.scripted import Scripted
from swarmdata.envs.pursuit.evader import EvaderModel, direction_table
from swarmdata.envs.pursuit.pursuit import Pursuit
from swarmdata.envs.pursuit.pursuit_rules import PursuitRules
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.state_layout import X, Y, robots_of
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Double, Float, Int, Seeds, Step

RINGS: Double = np.zeros((0, 2))  # leads of a team that surrounds (`groups.choose_goals`)


@kernel
def choose_all(
    seeds: Seeds,
    times: Int,
    states: Float,
    heard: Double,  # [E, N, N, 5] of `heard_goals`
    layouts: Float,
    leads: Double,  # [N, 2] or [0, 2]
    hunt: Hunt,
    beliefs: Beliefs,
    plans: Plans,
    goals: Double,  # [E, N, 2] written, m
) -> None:
    """Writes where the robots of all copies go, as `choose_goals` does for one."""
    for b in range(states.shape[0]):
        believed = Beliefs(
            beliefs.places[b], beliefs.velocities[b], beliefs.ages[b], beliefs.are_gone[b],
            beliefs.mates[b], beliefs.told[b],
        )  # fmt: skip
        planned = Plans(
            plans.groups[b], plans.grouped_for[b], plans.are_closing[b], plans.waits[b],
            plans.search_places[b], plans.search_ends[b],
        )  # fmt: skip
        update_beliefs(states[b], heard[b], layouts[b], hunt, believed)
        choose_goals(seeds[b], times[b], layouts[b], leads, hunt, believed, planned, goals[b])


class PursuitController(Scripted):
    """Surrounds evaders and closes in; with leads, each robot chases the nearest one instead.

    It knows the map, and all robots and evaders where robots see everything. Otherwise each robot
    knows what it sees and remembers (`step.states`), and what messages with payload `pose_and_goal`
    say (`step.observations`); it avoids those that are near.

    Args:
        spec: the task; its robots may differ from each other in every way.
        noise: standard deviation of the Gaussian noise on each command.
        leads: of robots that chase (`groups.goals_of_chases`), [N, 2].

    Raises:
        SpecError: `noise` is not a standard deviation, the spec is another task's, or the arena is
            too large to be mapped.
    """

    def __init__(self, spec: TaskSpec, *, noise: float = 0.0, leads: Double = RINGS) -> None:
        rules, task = spec.rules_as(PursuitRules), Pursuit(spec)
        super().__init__(spec, noise=noise)
        self._n_agents, self._heard, self._leads = spec.n_agents, HeardGoals(task), leads
        model = EvaderModel.of(spec, rules)
        self._hunt = Hunt(
            task.columns, model.half, max(robot.radius for robot in spec.robots),
            model.pursuer_speed, model.speed, model.dt, rules.sight_range or 0.0, rules.captors,
            direction_table(N_DIRECTIONS),
        )  # fmt: skip
        n_views = 1 if rules.sight_range is None else spec.n_agents
        self._sizes = (n_views, spec.n_agents, rules.evaders)
        self._beliefs, self._plans = blank_beliefs(0, *self._sizes), blank_plans(0, *self._sizes)

    def reset(self, step: Step, copies: Int) -> None:
        super().reset(step, copies)
        if len(step.seeds) != len(self._beliefs.ages):
            self._beliefs = blank_beliefs(len(step.seeds), *self._sizes)
            self._plans = blank_plans(len(step.seeds), *self._sizes)
        blank = (*blank_beliefs(len(copies), *self._sizes), *blank_plans(len(copies), *self._sizes))
        for kept, fresh in zip((*self._beliefs, *self._plans), blank, strict=True):
            kept[copies] = fresh
        starts = robots_of(step.states[copies], self._n_agents)[:, None, :, X : Y + 1]
        self._beliefs.mates[copies] = starts

    def commands(self, step: Step) -> Double:
        goals: Double = np.empty((len(step.seeds), self._n_agents, 2))
        choose_all(
            step.seeds, step.times, step.states, self._heard.of(step), step.layouts, self._leads,
            self._hunt, self._beliefs, self._plans, goals,
        )  # fmt: skip
        return self._navigator.commands(step, goals)


STRAIGHT, ONE_SECOND, THREE_SECONDS = (0.0, 0.0), (0.5, 1.0), (2.0, 3.0)
"""Share of the time to the evader, and largest time, s."""


class Greedy(PursuitController):
    """Every robot drives straight at the evader."""

    leads_in_turn: ClassVar[tuple[tuple[float, float], ...]] = (STRAIGHT,)

    def __init__(self, spec: TaskSpec, *, noise: float = 0.0) -> None:
        leads = [self.leads_in_turn[i % len(self.leads_in_turn)] for i in range(spec.n_agents)]
        super().__init__(spec, noise=noise, leads=np.array(leads))


class LeadOne(Greedy):
    """Every robot aims up to 1 s ahead of the evader."""

    leads_in_turn = (ONE_SECOND,)


class LeadThree(Greedy):
    """Every robot aims up to 3 s ahead of the evader."""

    leads_in_turn = (THREE_SECONDS,)


class LeadMixed(Greedy):
    """Robots aim 0 s, up to 1 s and up to 3 s ahead of the evader, in turn."""

    leads_in_turn = (STRAIGHT, ONE_SECOND, THREE_SECONDS)
