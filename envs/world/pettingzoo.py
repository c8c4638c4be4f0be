"""One copy of a task as a ParallelEnv of PettingZoo."""

import secrets
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray
from pettingzoo import ParallelEnv

from swarmdata.errors import SchemaError, SpecError
from swarmdata.numerics.random import EVALUATION_BASE, checked_seeds, derive
from swarmdata.perception.sensing.scans import scan_of
from swarmdata.registry.components import make_env
from swarmdata.specs.features import Feature
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Float, Step

RENDER_MODES = ("rgb_array",)


class ParallelWorld(ParallelEnv[str, Float, Float]):
    """One copy of a task with PettingZoo's API.

    All agents stay in `agents` until the episode ends for the whole team. The info of an agent
    contains `success` and its safety events in the step.

    Args:
        spec: the task.
        render_mode: "rgb_array", or None.

    Raises:
        SpecError: another render mode.
    """

    def __init__(self, spec: TaskSpec, render_mode: str | None = None) -> None:
        if render_mode not in (None, *RENDER_MODES):
            raise SpecError(
                f"render_mode {render_mode!r} is unknown; use None or one of {RENDER_MODES}"
            )
        self.metadata = {
            "name": f"{spec.task}_v{spec.version}",
            "render_modes": list(RENDER_MODES),
            "render_fps": round(1 / spec.control_dt),
            "is_parallelizable": True,
        }
        self.spec, self.render_mode = spec, render_mode
        self.possible_agents = list(spec.agent_names)
        self.agents: list[str] = []
        self._env = make_env(spec, 1)
        self._step: Step | None = None
        self._seed, self._episode = secrets.randbits(62), 0
        high = np.full(self._env.observation_size, np.inf, dtype=np.float32)
        self.observation_spaces = {
            name: gymnasium.spaces.Box(-high, high) for name in self.possible_agents
        }
        one = np.ones(self._env.action_size, dtype=np.float32)
        self.action_spaces = {
            name: gymnasium.spaces.Box(-one, one) for name in self.possible_agents
        }
        wide = np.full(self._env.state_size, np.inf, dtype=np.float32)
        self.state_space = gymnasium.spaces.Box(-wide, wide)

    def observation_space(self, agent: str) -> gymnasium.Space[Any]:
        """Returns the space of one agent's observations, Box [O]."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> gymnasium.Space[Any]:
        """Returns the space of one agent's actions, Box(-1, 1) [A]; a message comes last."""
        return self.action_spaces[agent]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Float], dict[str, dict[str, Any]]]:
        """Starts an episode.

        With a seed, this is the episode of the same seed in the vectorised environment, and the
        seed determines the episodes of later resets without a seed.
        """
        if seed is not None:
            episode = checked_seeds([seed])
            self._seed, self._episode = int(seed), 0
        else:
            self._episode += 1
            episode = derive(np.uint64(self._seed), self._episode) % np.uint64(EVALUATION_BASE)
        self.agents = list(self.possible_agents)
        step = self._env.reset(episode)
        self._step = step
        return self._rows(step.observations), self._infos(step)

    def step(
        self, actions: dict[str, Float]
    ) -> tuple[
        dict[str, Float],
        dict[str, float],
        dict[str, bool],
        dict[str, bool],
        dict[str, dict[str, Any]],
    ]:
        """Advances the episode by one control step; actions are one array [A] per agent."""
        names = self.agents
        step = self._env.step(self.joint(actions))
        self._step = step
        terminated, truncated = step.terminations.item(), step.truncations.item()
        results = (
            self._rows(step.observations),
            dict(zip(names, step.rewards[0].tolist(), strict=True)),
            dict.fromkeys(names, terminated),
            dict.fromkeys(names, truncated),
            self._infos(step),
        )
        if terminated or truncated:
            self.agents = []
        return results

    def state(self) -> Float:
        """Returns the global state, [S]."""
        return self.current_step.states[0].copy()

    @property
    def features(self) -> tuple[Feature, ...]:
        """The meaning of each number in an observation, O long."""
        return self._env.features

    @property
    def current_step(self) -> Step:
        """The last step of the vectorised environment, with one copy.

        Raises:
            SchemaError: the environment has not been reset.
        """
        if self._step is None:
            raise SchemaError("the environment has not been reset; call reset() first")
        return self._step

    def render(self) -> NDArray[np.uint8] | None:
        """Returns a picture of the world, [H, W, 3], or None without a render mode.

        It includes the rays of a lidar and the messages that arrived in this step.
        """
        if self.render_mode is None:
            return None
        from swarmdata.envs.render import draw  # noqa: PLC0415  (drawing is an extra)

        step = self.current_step
        talks = step.delivered.shape[-1] > 0
        return draw(
            self.spec,
            step.layouts[0],
            step.states[0],
            events=step.events[0],
            scan=scan_of(self._env.features, step.observations[0]),
            messages=(step.delivered[0], None) if talks else None,
        )

    def close(self) -> None:
        """Does nothing: there is no window."""

    def joint(self, actions: dict[str, Float]) -> Float:
        """Returns the actions of all agents, float32 [1, N, A].

        Raises:
            SchemaError: the episode does not run, or an agent has no such action.
        """
        if not self.agents:
            raise SchemaError("the episode has ended or was never started; call reset() first")
        try:
            joint = np.array([[actions[name] for name in self.agents]], dtype=np.float32)
        except KeyError:
            missing = [name for name in self.agents if name not in actions]
            raise SchemaError(
                f"no action for {', '.join(missing)}; give one for each of {self.agents}"
            ) from None
        except (TypeError, ValueError):
            joint = np.zeros(0, dtype=np.float32)
        if joint.shape[1:] != (len(self.agents), self._env.action_size):
            raise SchemaError(
                f"the actions are {actions!r:.200}, expected a dictionary with an array of "
                f"{self._env.action_size} numbers for each of {self.agents}"
            )
        return joint

    def _rows(self, values: NDArray[Any]) -> dict[str, NDArray[Any]]:
        """Returns each agent's row of a copy, since the step shares its memory with other steps."""
        return dict(zip(self.agents, values[0].copy(), strict=True))

    def _infos(self, step: Step) -> dict[str, dict[str, Any]]:
        success = step.successes.item()
        return {
            name: {"success": success, "events": row}
            for name, row in self._rows(step.events).items()
        }
