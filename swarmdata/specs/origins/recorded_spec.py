"""RecordedSpec, an environment of another library: its name and its spaces."""

from math import isfinite
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import Field, model_validator

from swarmdata.errors import SchemaError, UnknownNameError
from swarmdata.specs.frozen import Frozen, Positive
from swarmdata.specs.plain_names import Name, Text, repeated
from swarmdata.specs.spaces import Space, bounds, column_names, is_continuous, width
from swarmdata.types import Column

MAX_COLUMNS = 1 << 24
"""Most numbers in a state, an observation or an action of a recorded environment."""


class RecordedAgent(Frozen):
    """One agent of a recorded environment."""

    name: Name
    observation: Space
    action: Space


class RecordedSpec(Frozen):
    """An environment of another library: its name, and the spaces of its agents.

    Observations and actions of smaller agents are padded with zeros to the widest, on the right.
    """

    later_fields: ClassVar[tuple[str, ...]] = ("time_step",)
    world: ClassVar[None] = None  # this package cannot simulate it

    kind: Literal["recorded"] = "recorded"
    task: Annotated[str, Field(pattern=r"^[a-z0-9_]+$", max_length=96)]
    """Such as "simple_spread_v3"."""
    library: Text = ""  # such as "mpe2"; empty if not known
    version: Text = ""  # of the library
    options: dict[str, Any] = Field(default_factory=dict)  # it was made with; those that are known
    agents: Annotated[tuple[RecordedAgent, ...], Field(min_length=1)]
    state_size: Annotated[int, Field(ge=0, le=MAX_COLUMNS)]
    state_from: Literal["environment", "observations", "poses"]
    """Observations: all of them, concatenated; poses: those of logged robots."""
    horizon: Annotated[int, Field(ge=1, le=10**9)] | None = None  # None: not known
    time_step: Positive | None = None  # s, of a joint step; None: not known

    @model_validator(mode="after")
    def _check_agents(self) -> Self:
        names = self.agent_names
        if twice := repeated(names):
            raise ValueError(f"several agents are named {', '.join(twice)}, expected one each")
        widest = max(self.observation_size, self.action_size)
        if widest > MAX_COLUMNS:
            raise ValueError(f"an agent has {widest} numbers, at most {MAX_COLUMNS} are allowed")
        sizes = {"observation": self.observation_size, "action": self.action_size}
        if empty := [name for name, size in sizes.items() if not size]:
            raise ValueError(f"no agent has a number in its {' or '.join(empty)}, expected some")
        return self

    def columns(self, array: str, agent: int) -> tuple[Column, ...]:
        """The columns of an agent's rows of `observations` or `actions`, without the padding.

        Raises:
            UnknownNameError: another array, whose columns the environment does not name.
            SchemaError: there is no such agent.
        """
        if not 0 <= agent < self.n_agents:
            raise SchemaError(
                f"agent {agent} of {self.n_agents}, expected 0 to {self.n_agents - 1}"
            )
        own = self.agents[agent]
        spaces = {"observations": own.observation, "actions": own.action}
        if array not in spaces:
            raise UnknownNameError("array with columns", array, spaces)
        lows, highs = (
            [x if isfinite(x) else None for x in each.tolist()] for each in bounds(spaces[array])
        )
        meaning = f"as {self.task} has it"
        return tuple(
            Column(name, meaning, low=low, high=high)
            for name, low, high in zip(column_names(spaces[array]), lows, highs, strict=True)
        )

    @property
    def n_agents(self) -> int:
        """Number of agents, N."""
        return len(self.agents)

    @property
    def agent_names(self) -> tuple[str, ...]:
        """Names in agent order, N long."""
        return tuple(agent.name for agent in self.agents)

    @property
    def observation_size(self) -> int:
        """Columns of the widest agent's observation, O."""
        return max(width(agent.observation) for agent in self.agents)

    @property
    def action_size(self) -> int:
        """Columns of the widest agent's action, A."""
        return max(width(agent.action) for agent in self.agents)

    @property
    def action_kind(self) -> Literal["continuous", "choices"]:
        """`choices` as soon as one agent's action is not of real numbers only."""
        return "continuous" if all(map(is_continuous, self.action_spaces)) else "choices"

    @property
    def action_spaces(self) -> tuple[Space, ...]:
        """The space of each agent's actions, N long."""
        return tuple(agent.action for agent in self.agents)

    def observation_spaces(self, n_columns: int) -> tuple[Space, ...]:
        """The space of each agent's observations, N long; `n_columns` adds nothing here."""
        return tuple(agent.observation for agent in self.agents)

    @property
    def state_meaning(self) -> str:
        """What a row of `states` holds."""
        return {
            "environment": "The environment's own state().",
            "observations": "All observations, one agent's after the other's.",
            "poses": "x, y (m), cosine and sine of the heading of each agent, one after the other.",
        }[self.state_from]

    @property
    def facts(self) -> tuple[tuple[str, str], ...]:
        """The library and the options, for cards."""
        options = ", ".join(f"{key}={value!r}" for key, value in sorted(self.options.items()))
        return (
            ("library", f"{self.library} {self.version}".strip() or "not known"),
            ("options", options or "none"),
        )

    @property
    def limits(self) -> tuple[str, ...]:
        """Known limits, for cards."""
        unknown = "The version of the environment's library is not known."
        return () if self.version else (unknown,)
