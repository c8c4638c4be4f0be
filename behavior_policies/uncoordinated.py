"""The scripted team with less coordination; what is assigned at the reset, is among all robots."""

import numpy as np

from swarmdata.perception.observer import features_of
from swarmdata.registry.components import make_policy, make_task
from swarmdata.rollouts.action_probabilities import noisy_log_probs
from swarmdata.specs.state_layout import TX, TY, VX, VY, X, Y, robots_of
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Float, Int, Step

AWAY_DISTANCE = 100.0  # m to robots that are out of reach, and between any two of them
MESSAGE_PREFIX = "message_"  # of the names of all features that messages bring


class Deaf:
    """The scripted team to which no message arrives."""

    uses_state = True

    def __init__(self, spec: TaskSpec) -> None:
        self._team = make_policy("scripted", spec)
        names = (feature.name for feature in features_of(make_task(spec)))
        self._is_message = np.array([name.startswith(MESSAGE_PREFIX) for name in names])

    def reset(self, step: Step, copies: Int) -> None:
        self._team.reset(self._unheard(step), copies)

    def act(self, step: Step) -> Float:
        return self._team.act(self._unheard(step))

    def log_probs(self, step: Step, actions: Float) -> Float:
        return noisy_log_probs(self.act(step).astype(np.float64), actions, 0.0)

    def _unheard(self, step: Step) -> Step:
        heard = np.where(self._is_message, np.float32(0.0), step.observations)
        return step._replace(observations=heard)


class Naive:
    """Each robot runs the scripted controller, and takes the others for parked where they are."""

    uses_state = True

    def __init__(self, spec: TaskSpec) -> None:
        self._n_agents = spec.n_agents
        self._has_shared_target = spec.rules.payload_field is not None  # where the payload goes
        self._team = make_policy("scripted", spec)

    def reset(self, step: Step, copies: Int) -> None:
        """Lets every robot plan for the whole team, as it is, in `copies`."""
        n = self._n_agents
        self._team.reset(_repeated(step, n), (n * copies[:, None] + np.arange(n)).ravel())

    def act(self, step: Step) -> Float:
        n = self._n_agents
        seen = _repeated(step, n)  # row b * N + i is what robot i of copy b sees
        robots, is_own = robots_of(seen.states, n), np.eye(n, dtype=np.bool_)
        for i in range(n):
            robots[i::n, ~is_own[i]] = self._changed(robots[i::n, ~is_own[i]])
        every = np.arange(n)
        actions = self._team.act(seen)
        return actions.reshape(-1, n, *actions.shape[1:])[:, every, every]

    def log_probs(self, step: Step, actions: Float) -> Float:
        return noisy_log_probs(self.act(step).astype(np.float64), actions, 0.0)

    def _changed(self, others: Float) -> Float:
        """Returns what a robot takes the others for, columns `state_layout.ROBOT`, [E, N-1, 8]."""
        others[..., [VX, VY]] = 0.0
        if not self._has_shared_target:
            others[..., [TX, TY]] = others[..., [X, Y]]
        return others


class Alone(Naive):
    """Each robot runs the scripted controller as if the others were out of reach."""

    def _changed(self, others: Float) -> Float:
        others[..., X] = others[..., Y] = AWAY_DISTANCE * np.arange(1, others.shape[-2] + 1)
        return super()._changed(others)


def _repeated(step: Step, times: int) -> Step:
    return Step._make(np.repeat(array, times, axis=0) for array in step)
