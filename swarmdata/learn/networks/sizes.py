"""Sizes, the numbers that shape an algorithm's networks."""

from dataclasses import dataclass

from swarmdata.errors import SchemaError
from swarmdata.perception.frames import Frame
from swarmdata.types import Batch, Episode


@dataclass(frozen=True, slots=True)
class Sizes:
    """Numbers of agents and of features, and what there is to choose from.

    Raises:
        SchemaError: a size is below 1.
    """

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
        """Checks that every size is positive."""
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
