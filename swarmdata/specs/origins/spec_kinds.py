"""Spec, the protocol of everything that can be recorded, one side of a task, and all kinds."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Protocol, Self, Union

from pydantic import Discriminator, Tag, model_validator

from swarmdata.specs.frozen import Document, Dumps, Frozen
from swarmdata.specs.origins.recorded_spec import RecordedSpec
from swarmdata.specs.plain_names import Name, Text
from swarmdata.specs.rules import Side
from swarmdata.specs.spaces import Space
from swarmdata.specs.task_spec import Robot, TaskSpec


class Spec(Document, Dumps, Protocol):
    """What was recorded: a task of this library, or any other environment with agents."""

    @property
    def kind(self) -> str: ...  # its key in `SPEC_KINDS`
    @property
    def world(self) -> TaskSpec | None: ...  # the task that this package simulates, if it is one
    @property
    def task(self) -> str: ...  # name of the task or environment
    @property
    def library(self) -> str: ...  # the library that has it, empty if that is not known
    @property
    def n_agents(self) -> int: ...  # number of agents, N
    @property
    def agent_names(self) -> tuple[str, ...]: ...  # names in agent order, N long
    @property
    def observation_size(self) -> int: ...  # columns of an observation, O, the widest agent's
    @property
    def state_size(self) -> int: ...  # columns of a state, S
    @property
    def action_size(self) -> int: ...  # columns of an action, A, the widest agent's
    @property
    def action_kind(self) -> Literal["unit", "continuous", "choices"]:
        """Commands in [-1, 1], real numbers with bounds of their own, or discrete choices."""
        ...

    @property
    def action_spaces(self) -> tuple[Space, ...]: ...  # the space of each agent's actions, N long
    def observation_spaces(self, n_columns: int) -> tuple[Space, ...]:
        """The space of each agent's observations, N long; stored ones have `n_columns`, O."""
        ...

    @property
    def horizon(self) -> int | None: ...  # most joint steps of an episode, None if not known
    @property
    def time_step(self) -> float | None: ...  # duration of a joint step, s; None if not known
    @property
    def state_meaning(self) -> str: ...  # what a row of `states` holds, one sentence
    @property
    def facts(self) -> tuple[tuple[str, str], ...]: ...  # more rows of a card's first table
    @property
    def limits(self) -> tuple[str, ...]: ...  # known limits of datasets of it, sentences for a card


class SideSpec(Frozen):
    """One side of a task. Nobody can simulate it alone: that takes policies for the other sides."""

    later_fields: ClassVar[tuple[str, ...]] = ("opponents",)
    world: ClassVar[None] = None
    library: ClassVar[str] = "swarmdata"
    action_kind: ClassVar[Literal["unit"]] = "unit"
    facts: ClassVar[tuple[()]] = ()
    limits: ClassVar[tuple[()]] = ()

    kind: Literal["side"] = "side"
    whole: TaskSpec  # the task of all sides
    side: Name  # whose robots these are
    opponents: Text | None = None  # who played the other sides, of results

    @model_validator(mode="after")
    def _check_side(self) -> Self:
        self.whole.side(self.side)
        return self

    @property
    def agents(self) -> Side:
        """The side, with the indices of its agents in the task."""
        return self.whole.side(self.side)

    @property
    def task(self) -> str:
        against = "" if self.opponents is None else f" against {self.opponents}"
        return f"{self.whole.task}: {self.side}{against}"

    @property
    def n_agents(self) -> int:
        return len(self.agents.agents)

    @property
    def agent_names(self) -> tuple[str, ...]:
        return tuple(self.whole.agent_names[i] for i in self.agents.agents)

    @property
    def robots(self) -> tuple[Robot, ...]:
        return tuple(self.whole.robots[i] for i in self.agents.agents)

    @property
    def observation_size(self) -> int:
        return self.whole.observation_size

    @property
    def state_size(self) -> int:
        return self.whole.state_size

    @property
    def action_size(self) -> int:
        return self.whole.action_size

    @property
    def action_spaces(self) -> tuple[Space, ...]:
        return tuple(self.whole.action_spaces[i] for i in self.agents.agents)

    def observation_spaces(self, n_columns: int) -> tuple[Space, ...]:
        return self.whole.observation_spaces(n_columns)[: self.n_agents]

    @property
    def horizon(self) -> int:
        return self.whole.horizon

    @property
    def time_step(self) -> float:
        return self.whole.time_step

    @property
    def state_meaning(self) -> str:
        return self.whole.state_meaning


SPEC_KINDS: dict[str, type[Frozen]] = {
    "task": TaskSpec, "recorded": RecordedSpec, "side": SideSpec,
}  # fmt: skip
"""Every kind of spec by its `kind`; plain data without one are a task."""


def _spec_kind(value: Any) -> str:
    kind = value.get("kind") if isinstance(value, Mapping) else getattr(value, "kind", None)
    return kind if isinstance(kind, str) and kind in SPEC_KINDS else "task"


if TYPE_CHECKING:
    AnySpec = Spec
else:
    AnySpec = Annotated[
        Union[tuple(Annotated[model, Tag(kind)] for kind, model in SPEC_KINDS.items())],  # noqa: UP007
        Discriminator(_spec_kind),
    ]
    """A field of a pydantic model that holds a spec of any kind."""
