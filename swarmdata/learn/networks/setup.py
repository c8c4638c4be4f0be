"""Setup and Sizes: what every offline algorithm is made from beside its settings."""

from collections.abc import Sequence
from dataclasses import dataclass

import torch

from swarmdata.errors import SchemaError
from swarmdata.learn.networks.dataset_statistics import Statistics
from swarmdata.learn.networks.network_inputs import generators
from swarmdata.perception.frames import Frame
from swarmdata.types import Batch, Episode


@dataclass(frozen=True, slots=True)
class Sizes:
    """Numbers of agents and of features, and what there is to choose from."""

    n_agents: int  # N
    observation: int  # O
    action: int  # A
    state: int  # S
    choices: tuple[tuple[range, ...], ...] = ()  # [N], by column; empty: actions are continuous
    frame: Frame | None = None  # that observations and actions are in; None: the world's
    robot_columns: int = 0  # of a state for each robot, the first N times as many; 0: unknown
    state_vectors: tuple[int, ...] = ()  # x components of a state's planar vectors; y follows each
    features: tuple[str, ...] = ()  # names, without what the frame adds; empty: unknown

    def __post_init__(self) -> None:
        for name in ("n_agents", "observation", "action", "state"):
            if getattr(self, name) < 1:
                raise SchemaError(f"{self}: {name} must be at least 1")

    @property
    def information(self) -> int:
        """Features of x = (state, all observations), S + N O."""
        return self.state + self.n_agents * self.observation

    @classmethod
    def of(cls, batch: Batch | Episode) -> "Sizes":
        """Reads the sizes from the last axes of an episode or a batch with continuous actions."""
        n_agents, observation = batch.observations.shape[-2:]
        return cls(n_agents, observation, batch.actions.shape[-1], batch.states.shape[-1])


@dataclass(frozen=True, slots=True, eq=False)
class Setup:
    """Networks' sizes, seeds, the dataset's statistics, and where to train."""

    sizes: Sizes
    seeds: Sequence[int]  # of initial parameters and noise, [K]
    statistics: Statistics  # for normalization, the scale of rewards, and R*
    device: torch.device | str = "cpu"
    n_episodes: int = 0  # of the data, for what is learned of each; 0 where that is not known

    @property
    def n_seeds(self) -> int:
        return len(self.seeds)

    def generators(self) -> list[torch.Generator]:
        """Makes one generator of noise for each seed, [K]."""
        return generators(self.seeds, self.device)
