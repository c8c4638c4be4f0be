"""Edit, a dataset of episodes of other datasets."""

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from swarmdata.specs.frozen import Frozen
from swarmdata.specs.origins.spec_kinds import AnySpec
from swarmdata.specs.plain_names import Label, Sha256, Text
from swarmdata.specs.recipe import Id, Policies

EpisodeNumber = Annotated[int, Field(ge=0, lt=1 << 40)]


class Parent(Frozen):
    """A dataset that another was made from, and which of its episodes were taken."""

    id: Id
    digest: Sha256
    episodes: Annotated[tuple[EpisodeNumber, ...], Field(min_length=1)]  # stored, increasing


class Edit(Frozen):
    """A dataset of episodes of others, each with the split it had."""

    can_rebuild: ClassVar[bool] = True
    missing: ClassVar[None] = None
    recipe: ClassVar[None] = None  # it is made from its parents
    split_rule: ClassVar[None] = None  # every episode keeps the split that it had in its parent
    source_sha256: ClassVar[None] = None  # the parents have digests instead
    remaking: ClassVar[None] = None  # a card lists the parents instead
    license: ClassVar[str] = "unknown"  # that of the parents, which are not at hand
    metadata: ClassVar[None] = None

    kind: Literal["edit"] = "edit"
    id: Id
    tier: Label
    spec: AnySpec
    policies: Policies  # that made its episodes
    parents: Annotated[tuple[Parent, ...], Field(min_length=1)]
    operation: Text  # the command that made it, in words

    @property
    def has_world_seeds(self) -> bool:
        """As parents with recipes promise, whose policies are all known."""
        return all(policy.name != "external" for policy in self.policies)

    @property
    def source(self) -> str:
        return self.operation

    @property
    def about_tier(self) -> str:
        return f"Made from other datasets, its parents (below), by: {self.operation}."
