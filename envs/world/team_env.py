"""One copy of a task as an environment of Gymnasium, in which the team is one agent."""

from collections.abc import Mapping
from itertools import cycle
from typing import Any, ClassVar

import gymnasium
import numpy as np
from numpy.typing import NDArray

from swarmdata.envs.world.pettingzoo import RENDER_MODES, ParallelWorld
from swarmdata.numerics.random import evaluation_seeds
from swarmdata.perception.frames import Frame, find_frame, in_world
from swarmdata.specs.spaces import DictSpace, to_gymnasium
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Float, Step

N_RESERVED = 1_000  # reserved evaluation episodes, after which `reserved` begins again


class TeamEnv(gymnasium.Env[dict[str, Float], dict[str, Float]]):
    """One copy of a task with Gymnasium's API.

    Observations and actions are dictionaries with an array for each robot, the reward is the mean
    of theirs. The info has `success`, `states` [S], and each robot's reward and events as
    `agent_rewards` [N] and `events` [N, 4]. `reset(seed=s)` plays the episode of seed s.

    Args:
        spec: the task, or its fields.
        frame: in which robots observe and act, as `frames.find_frame` takes it.
        reserved: whether resets without a seed play the reserved evaluation episodes in order.
        render_mode: "rgb_array", or None.

    Raises:
        SpecError: the spec is malformed or of an older version of the world, or its observations
            have no such frame.
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": list(RENDER_MODES)}

    def __init__(
        self,
        spec: TaskSpec | Mapping[str, Any],
        frame: str = "world",
        reserved: bool = False,
        render_mode: str | None = None,
    ) -> None:
        self.task = spec if isinstance(spec, TaskSpec) else TaskSpec.parse(dict(spec), "the spec")
        self.render_mode = render_mode
        self._world = ParallelWorld(self.task, render_mode)
        self._frame: Frame | None = find_frame(self._world.features, frame, self.task.robots)
        self._reserved = cycle(evaluation_seeds(N_RESERVED).tolist()) if reserved else None
        names = self.task.agent_names
        size = len(self._world.features) + (0 if self._frame is None else self._frame.n_added)
        each = self.task.observation_spaces(size), self.task.action_spaces
        observation, action = (dict(zip(names, spaces, strict=True)) for spaces in each)
        self.observation_space = to_gymnasium(DictSpace(spaces=observation))
        self.action_space = to_gymnasium(DictSpace(spaces=action))

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Float], dict[str, Any]]:
        """Starts an episode: that of the seed, or the next one."""
        super().reset(seed=seed)
        if seed is None and self._reserved is not None:
            seed = next(self._reserved)
        self._world.reset(seed=seed)
        return self._observed(), self._info()

    def step(
        self, action: dict[str, Float]
    ) -> tuple[dict[str, Float], float, bool, bool, dict[str, Any]]:
        """Advances the episode by one control step; actions are one array [A] per robot."""
        if self._frame is not None:
            self._world.joint(action)  # refuses what is no action of each robot
            names = self.task.agent_names
            seen = self._world.current_step.observations
            joint = np.array([[action[name] for name in names]], dtype=np.float64)
            turned = in_world(self._frame, seen, joint)[0].astype(np.float32)
            action = dict(zip(names, turned, strict=True))
        self._world.step(action)
        step = self._world.current_step
        reward = step.rewards.mean(axis=1, dtype=np.float64).item()
        ends = step.terminations.item(), step.truncations.item()
        return self._observed(), reward, *ends, self._info()

    def render(self) -> NDArray[np.uint8] | None:
        """Returns a picture of the world, [H, W, 3], or None without a render mode."""
        return self._world.render()

    def _observed(self) -> dict[str, Float]:
        rows = self._world.current_step.observations
        rows = rows.copy() if self._frame is None else self._frame.inputs(rows)
        return dict(zip(self.task.agent_names, rows[0], strict=True))

    def _info(self) -> dict[str, Any]:
        step: Step = self._world.current_step
        return {
            "success": step.successes.item(),
            "states": step.states[0].copy(),
            "agent_rewards": step.rewards[0].copy(),
            "events": step.events[0].copy(),
        }
