"""Environments of PettingZoo's and Gymnasium's other interfaces as `ParallelEnv`s."""

from typing import Any

import gymnasium
from pettingzoo import AECEnv, ParallelEnv
from pettingzoo.utils.conversions import aec_to_parallel

from swarmdata.errors import SpecError

SINGLE_AGENT = "agent_0"  # name of the agent of a Gymnasium environment


def as_parallel(env: Any) -> Any:
    """Returns an environment whose agents act at once: itself if it is one.

    Agents of an `AECEnv` must be parallelizable; a Gymnasium environment gets one agent.

    Raises:
        SpecError: its agents act in turns, or it is several copies of an environment.
    """
    if isinstance(env, AECEnv):
        if not (env.metadata or {}).get("is_parallelizable", False):
            raise SpecError(
                f"{env} cannot be recorded, because its agents act in turns: it is an AECEnv whose "
                "metadata do not say is_parallelizable, which promises that its world only moves "
                "after the last agent of each cycle."
            )
        return aec_to_parallel(env)
    if isinstance(env, gymnasium.vector.VectorEnv):
        raise SpecError(
            f"{env} is a Gymnasium VectorEnv, which resets its copies by itself, expected a single "
            "environment: record each copy on its own."
        )
    return SingleAgentEnv(env) if isinstance(env, gymnasium.Env) else env


class SingleAgentEnv(ParallelEnv[str, Any, Any]):
    """A Gymnasium environment as a team of one, `SINGLE_AGENT`; it has no `state()`."""

    def __init__(self, env: "gymnasium.Env[Any, Any]") -> None:
        self.env, self.spec, self.render_mode = env, env.spec, env.render_mode
        name = type(env.unwrapped).__name__ if env.spec is None else env.spec.id
        self.metadata = {**env.metadata, "name": name}
        self.possible_agents = [SINGLE_AGENT]
        self.agents: list[str] = []

    @property
    def unwrapped(self) -> Any:
        return self.env.unwrapped

    def observation_space(self, agent: str) -> Any:
        return self.env.observation_space

    def action_space(self, agent: str) -> Any:
        return self.env.action_space

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        observation, info = self.env.reset(seed=seed, options=options)
        self.agents = list(self.possible_agents)
        return {SINGLE_AGENT: observation}, {SINGLE_AGENT: info}

    def step(
        self, actions: dict[str, Any]
    ) -> tuple[dict[str, Any], dict[str, Any], dict[str, bool], dict[str, bool], dict[str, Any]]:
        observation, reward, terminated, truncated, info = (
            {SINGLE_AGENT: value} for value in self.env.step(actions[SINGLE_AGENT])
        )
        if terminated[SINGLE_AGENT] or truncated[SINGLE_AGENT]:
            self.agents = []
        return observation, reward, terminated, truncated, info

    def render(self) -> Any:
        return self.env.render()

    def close(self) -> None:
        self.env.close()
