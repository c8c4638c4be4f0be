"""Cooperative navigation of OMAR's authors (ling-pan/OMAR, `multiagent-particle-envs`), to play in.

Their `simple_spread` is not that of PettingZoo: each agent's reward is the sum over landmarks of
min(1 / distance of the nearest agent, 10), less 5 for each agent it touches; commands are forces
(x, y) in [-1, 1]; episodes have 25 steps. It runs as it is, from a checkout; gym and seaborn, which
it imports for its base class, spaces and colors, are replaced.
"""

from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from tests.benchmarks.peers.checkouts import import_from

STEPS = 25
FOLDER = "multiagent-particle-envs"
GYM = {"Env": object, "spaces": gymnasium.spaces}


class ParticleWorld:
    """Their world with the part of PettingZoo's `ParallelEnv` that evaluation needs.

    Args:
        checkout: of ling-pan/OMAR.
    """

    metadata = {"name": "simple_spread"}  # noqa: RUF012  (as PettingZoo has it)

    def __init__(self, checkout: Path) -> None:
        folder = checkout / FOLDER
        absent = ("gym.envs", "gym.envs.registration", "seaborn")
        name = "multiagent.scenarios.simple_spread"
        scenario = import_from(folder, name, *absent, gym=GYM).Scenario()
        environment = import_from(folder, "multiagent.environment", *absent, gym=GYM)
        environment.MultiAgentEnv._reset_render = lambda _: None
        with redirect_stdout(StringIO()):  # it tells its number of agents
            world = scenario.make_world()
        self._world = environment.MultiAgentEnv(
            world, scenario.reset_world, scenario.reward, scenario.observation
        )
        self.possible_agents = [f"agent_{k}" for k in range(self._world.n)]
        self.agents: list[str] = []
        self._time = 0

    def observation_space(self, agent: str) -> Any:
        """Positions and velocities without bounds."""
        shape = self._world.observation_space[self.possible_agents.index(agent)].shape
        return gymnasium.spaces.Box(-np.inf, np.inf, shape, np.float32)

    def action_space(self, agent: str) -> Any:
        """A force in [-1, 1]^2."""
        shape = self._world.action_space[self.possible_agents.index(agent)].shape
        return gymnasium.spaces.Box(-1.0, 1.0, shape, np.float32)

    def reset(self, seed: int | None = None, options: Any = None) -> tuple[Any, Any]:
        """Begins an episode; their world draws from NumPy's global generator."""
        np.random.seed(seed)  # noqa: NPY002
        self.agents, self._time = list(self.possible_agents), 0
        return self._by_agent(self._world._reset()), {agent: {} for agent in self.agents}

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, Any]:
        """One step; the last truncates."""
        forces = [np.asarray(actions[agent], np.float64) for agent in self.agents]
        observations, rewards, _, _ = self._world._step(forces)
        self._time += 1
        acted, over = self.agents, self._time == STEPS
        if over:
            self.agents = []
        return (
            self._by_agent(observations),
            dict(zip(acted, map(float, rewards), strict=True)),
            dict.fromkeys(acted, False),
            dict.fromkeys(acted, over),
            {agent: {} for agent in acted},
        )

    def close(self) -> None:
        """There is nothing to close."""

    def _by_agent(self, rows: Any) -> dict[str, Any]:
        return {
            agent: np.asarray(row, np.float32)
            for agent, row in zip(self.possible_agents, rows, strict=True)
        }
