"""The scripted controller of `coop_nav`: to their goals, or to the goals assigned at the start."""

import numpy as np
from numba import njit

from swarmdata.assignment import assign, assignment_work
from swarmdata.behavior_policies.navigator import Navigator
from swarmdata.behavior_policies.noise import check_noise
from swarmdata.behavior_policies.scripted import actions_of
from swarmdata.envs.coverage import fill_distances
from swarmdata.errors import SpecError
from swarmdata.spec import NavigationRules, TaskSpec
from swarmdata.states import N_COLUMNS
from swarmdata.types import Double, Float, Int, Step


@njit(nogil=True, cache=True)
def assign_goals(states: Float, copies: Int, n: int, work: Double, places: Int, out: Double) -> None:
    """Writes the goal of each robot that makes the sum of squared distances least.

    Squares, so that no robot has much farther to go than the others: the last one decides when
    all goals are covered.

    Args:
        states: [E, S].
        copies: rows to read and write.
        n: number of robots and goals.
        work: memory of `assignment.assign`.
        places: the same.
        out: written, m, [E, N, 2].
    """
    costs = np.empty((n, n))
    for b in copies:
        fill_distances(states[b], n, costs)
        for i in range(n):
            for k in range(n):
                costs[i, k] *= costs[i, k]
        assign(costs, work, places)
        for i in range(n):
            first = N_COLUMNS * n + 2 * places[0, i]
            out[b, i, 0], out[b, i, 1] = states[b, first], states[b, first + 1]


class CoopNavScript:
    """Navigates to the robots' own goals; unassigned goals are assigned once, at the reset.

    Args:
        spec: a spec of `coop_nav`.
        noise: standard deviation of the Gaussian noise on each command.

    Raises:
        SpecError: the spec is another task's, or `noise` is not a standard deviation.
    """

    uses_state = True

    def __init__(self, spec: TaskSpec, *, noise: float = 0.0) -> None:
        if not isinstance(spec.rules, NavigationRules):
            raise SpecError(f"rules.task is {spec.rules.task!r}, expected 'coop_nav'")
        self._noise = check_noise(noise)
        self._n_agents, self._action_size = spec.n_agents, spec.action_size
        self._navigator = Navigator(spec)
        self._is_shared = spec.rules.goals == "unassigned"
        self._targets: Double = np.zeros((0, spec.n_agents, 2))
        self._work = assignment_work(spec.n_agents)

    def reset(self, step: Step, copies: Int) -> None:
        """Maps the layouts of `copies`, and assigns their goals if they belong to nobody."""
        self._navigator.reset(step, copies)
        if not self._is_shared:
            return
        if len(self._targets) != len(step.seeds):
            self._targets = np.zeros((len(step.seeds), self._n_agents, 2))
        assign_goals(step.states, copies, self._n_agents, *self._work, self._targets)

    def act(self, step: Step) -> Float:
        targets = self._targets if self._is_shared else None
        commands = self._navigator.commands(step, targets)
        return actions_of(commands, step, self._noise, self._action_size)
