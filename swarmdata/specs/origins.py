"""Where a dataset comes from: a recipe, a recording of another environment, or an edit of others.

It is the dataset's `recipe.json`. A recipe makes the dataset again; an edit does from its parents;
a recording is what it is.
"""

from collections.abc import Mapping
from typing import Annotated, Any, Literal, Self

from pydantic import Discriminator, Field, Tag, model_validator

from swarmdata.errors import SpecError
from swarmdata.specs.frozen import Frozen
from swarmdata.specs.plain_names import Label, Name, Sha256, Text, repeated
from swarmdata.specs.recipe import Policies, Recipe, Splits
from swarmdata.specs.spaces import Space, width
from swarmdata.specs.task_spec import TaskSpec

Id = Annotated[str, Field(pattern=r"^[a-z0-9_]+(-[a-z0-9_]+)+-v[0-9]+$", max_length=96)]
MAX_COLUMNS = 1 << 24
"""Numbers in a state, an observation or an action of a recorded environment."""


class RecordedAgent(Frozen):
    """One agent of a recorded environment."""

    name: Name
    observation: Space
    action: Space


class RecordedSpec(Frozen):
    """An environment that is not ours: what passed through its interface, and its name.

    Observations and actions of smaller agents are padded with zeros to the widest, on the right.
    """

    kind: Literal["recorded"] = "recorded"
    task: Annotated[
        str, Field(pattern=r"^[a-z0-9_]+$", max_length=96)
    ]  # such as "simple_spread_v3"
    library: Text = ""  # that has it, such as "mpe2"
    version: Text = ""  # of the library
    options: dict[str, Any] = Field(
        default_factory=dict
    )  # that it was made with, as far as they are known
    agents: Annotated[tuple[RecordedAgent, ...], Field(min_length=1)]
    state_size: Annotated[int, Field(ge=0, le=MAX_COLUMNS)]
    state_from: Literal["environment", "observations"]  # observations: all of them, concatenated
    horizon: Annotated[int, Field(ge=1, le=10**9)] | None = None  # None: not known

    @model_validator(mode="after")
    def _check_agents(self) -> Self:
        names = self.agent_names
        if twice := repeated(names):
            raise ValueError(f"several agents are named {', '.join(twice)}, expected one each")
        widest = max(self.observation_size, self.action_size)
        if widest > MAX_COLUMNS:
            raise ValueError(f"an agent has {widest} numbers, at most {MAX_COLUMNS} are allowed")
        return self

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


def _spec_kind(value: Any) -> str:
    kind = value.get("kind") if isinstance(value, Mapping) else getattr(value, "kind", None)
    return "recorded" if kind == "recorded" else "task"


AnySpec = Annotated[
    Annotated[TaskSpec, Tag("task")] | Annotated[RecordedSpec, Tag("recorded")],
    Discriminator(_spec_kind),
]
"""A task of this library, or another environment."""


class Recording(Frozen):
    """A dataset of steps that somebody took in an environment, here or elsewhere."""

    kind: Literal["recording"] = "recording"
    id: Id
    tier: Label = "recorded"
    spec: AnySpec
    policies: Policies  # shares mean nothing
    seed: Annotated[int, Field(ge=0, lt=1 << 32)] = 0  # of the splits
    splits: Splits | None = Splits()  # None: each episode has the split that it had in the source
    source: Text  # "recorder", or the format it was converted from
    source_sha256: Sha256 | None = None  # of the file that was converted
    metadata: dict[Text, Text] = Field(default_factory=dict)  # author, license, what users say


EpisodeNumber = Annotated[int, Field(ge=0, lt=1 << 40)]


class Parent(Frozen):
    """A dataset that another was made from, and which of its episodes were taken."""

    id: Id
    digest: Sha256
    episodes: Annotated[
        tuple[EpisodeNumber, ...], Field(min_length=1)
    ]  # stored numbers, increasing


class Edit(Frozen):
    """A dataset of episodes of others, each with the split it had."""

    kind: Literal["edit"] = "edit"
    id: Id
    tier: Label
    spec: AnySpec
    policies: Policies  # that made its episodes
    parents: Annotated[tuple[Parent, ...], Field(min_length=1)]
    operation: Text  # what was asked for, in words


Origin = Recipe | Recording | Edit
"""What `recipe.json` holds."""


def split_rule(origin: Origin) -> Splits | None:
    """The rule by which a dataset's episodes are split; None where they brought their splits."""
    return None if isinstance(origin, Edit) else origin.splits


def task_of(origin: Origin, purpose: str) -> TaskSpec:
    """The spec of a dataset of a task of this library.

    Args:
        origin: of the dataset.
        purpose: what needs the task, the subject of the error's sentence, such as "coverage".

    Raises:
        SpecError: the dataset was recorded in another environment.
    """
    if isinstance(origin.spec, RecordedSpec):
        raise SpecError(
            f"{origin.id} was recorded in {origin.spec.task}, an environment of "
            f"{origin.spec.library or 'another library'}; {purpose} needs a task of swarmdata."
        )
    return origin.spec


_KINDS: Mapping[str, type[Recording] | type[Edit]] = {"recording": Recording, "edit": Edit}


def parse_origin(data: Any, source: str) -> Origin:
    """Builds the origin that the content of a `recipe.json` is; without a `kind` it is a recipe.

    Raises:
        SpecError: it is malformed.
    """
    kind = data.get("kind") if isinstance(data, Mapping) else None
    model = _KINDS.get(kind, Recipe) if isinstance(kind, str) else Recipe
    return model.parse(data, source)
