"""Spec, the protocol of everything that can be recorded, and the table of its kinds."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any, Literal, Protocol, Self, Union

from pydantic import Discriminator, Tag

from swarmdata.specs.frozen import Frozen
from swarmdata.specs.origins.recorded_spec import RecordedSpec
from swarmdata.specs.spaces import Space
from swarmdata.specs.task_spec import TaskSpec


class Spec(Protocol):
    """What was recorded: a task of this library, or any other environment with agents.

    Frozen data that is parsed from JSON, compared by value and hashed.
    """

    @property
    def kind(self) -> str: ...  # its key in `SPEC_KINDS`
    @property
    def world(self) -> TaskSpec | None:
        """The task that this package can simulate, None for environments of others."""
        ...

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
    def action_size(self) -> int:
        """Columns of an action, A; of agents with different spaces, the widest."""
        ...

    @property
    def action_kind(self) -> Literal["unit", "continuous", "choices"]:
        """Commands in [-1, 1], real numbers with bounds of their own, or discrete choices."""
        ...

    @property
    def action_spaces(self) -> tuple[Space, ...]: ...  # the space of each agent's actions, N long
    def observation_spaces(self, n_columns: int) -> tuple[Space, ...]:
        """The space of each agent's observations, N long.

        Args:
            n_columns: of the stored observations, O.
        """
        ...

    @property
    def horizon(self) -> int | None:
        """Most joint steps of an episode, None if that is not known."""
        ...

    @property
    def time_step(self) -> float | None:
        """Duration of a joint step, s; None if that is not known."""
        ...

    @property
    def state_meaning(self) -> str: ...  # what a row of `states` holds, one sentence
    @property
    def facts(self) -> tuple[tuple[str, str], ...]:
        """Further rows of a card's first table: name and value."""
        ...

    @property
    def limits(self) -> tuple[str, ...]: ...  # known limits of datasets of it, sentences for a card
    def hash(self) -> str:
        """SHA-256 of its canonical JSON, hex."""
        ...

    def to_json(self) -> str:
        """Canonical JSON."""
        ...

    def model_dump(self, *, mode: Literal["json"]) -> dict[str, Any]:
        """Its fields as plain data."""
        ...

    def model_copy(self, *, update: Mapping[str, Any] | None = None) -> Self:
        """A copy with some fields replaced, which are not checked."""
        ...


SPEC_KINDS: dict[str, type[Frozen]] = {"task": TaskSpec, "recorded": RecordedSpec}
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
