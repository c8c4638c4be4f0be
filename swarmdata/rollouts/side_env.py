"""SideEnv, copies of a task in which given policies move all sides but one."""

import numpy as np

from swarmdata.errors import SchemaError
from swarmdata.interfaces import Policy, VecEnv
from swarmdata.rollouts.side_policy import play_sides, step_of_side
from swarmdata.specs.origins import SideSpec
from swarmdata.types import Double, Float, Int, Seeds, Step


class SideEnv:
    """Copies of a task that are stepped with the actions of one side; opponents act for the others.

    Used like `interfaces.VecEnv`, but for its `spec`, which is that of a side. Steps have the rows
    of the side's robots, and the state of all. Opponents are as `play_sides` takes them.
    """

    def __init__(self, whole: VecEnv, spec: SideSpec, opponents: Policy | str) -> None:
        self.whole, self.spec, self._opponents = whole, spec, opponents
        self.task, self.n_copies, self.features = whole.task, whole.n_copies, whole.features
        self.observation_size, self.action_size = whole.observation_size, whole.action_size
        self.state_size = whole.state_size
        self._given = _Given()
        self._team = play_sides(spec.whole, spec.side, self._given, opponents)
        self._current_step: Step | None = None

    def over(self, whole: VecEnv) -> "SideEnv":
        """The same side and opponents in other copies of the task."""
        return SideEnv(whole, self.spec, self._opponents)

    @property
    def whole_step(self) -> Step:
        """The last step of all sides; SchemaError before the first reset."""
        if self._current_step is None:
            raise SchemaError("step was called before the first reset; call env.reset(seeds) first")
        return self._current_step

    def reset(self, seeds: Seeds, copies: Int | None = None) -> Step:
        """Starts episodes in `copies`; see `interfaces.VecEnv.reset`."""
        step = self._current_step = self.whole.reset(seeds, copies)
        self._team.reset(step, np.arange(self.n_copies) if copies is None else copies)
        return step_of_side(step, self.spec.agents)

    def step(self, actions: Float | Double) -> Step:
        """Advances the copies that have not ended, with the side's actions, [E, N, A].

        Raises:
            SchemaError: `actions` has the wrong shape, or is not finite.
        """
        self._given.actions = actions
        self._current_step = self.whole.step(self._team.act(self.whole_step))
        return step_of_side(self._current_step, self.spec.agents)

    def close(self) -> None:
        self.whole.close()


class _Given:
    """Implements `Policy`: it takes actions that were chosen elsewhere."""

    uses_state = False

    def __init__(self) -> None:
        self.actions: Float | Double = np.empty((0, 0, 0))

    def reset(self, step: Step, copies: Int) -> None:
        """Does nothing: there is no memory."""

    def act(self, step: Step) -> Float:
        return self.actions.astype(np.float32)

    def log_probs(self, step: Step, actions: Float) -> Float:
        """Zeros: the actions are certain."""
        return np.zeros(actions.shape[:2], dtype=np.float32)


AnyEnv = VecEnv | SideEnv


def whole_of(env: AnyEnv) -> VecEnv:
    """The copies of all sides."""
    return env.whole if isinstance(env, SideEnv) else env


def seen_in(whole: VecEnv, env: AnyEnv) -> AnyEnv:
    """Changed copies of `env`'s task, as those who act in `env` see them."""
    return env.over(whole) if isinstance(env, SideEnv) else whole
