"""Recipe, everything that determines a generated dataset: task, policies, seeds, splits."""

from collections.abc import Iterable, Iterator
from itertools import chain
from typing import Annotated, ClassVar, NamedTuple, Self

from pydantic import AfterValidator, Field, model_validator

from swarmdata.specs.budget import part_excess
from swarmdata.specs.frozen import Frozen, Positive
from swarmdata.specs.plain_names import FileName, Label, Sha256, Text, repeated
from swarmdata.specs.quantities import Count, Deviation
from swarmdata.specs.task_spec import TaskSpec

MOST_POLICIES = 256  # most policies of a dataset: their indices are bytes

Id = Annotated[str, Field(pattern=r"^[a-z0-9_]+(-[a-z0-9_]+)+-v[0-9]+$", max_length=96)]
"""Id of a dataset: words joined by -, and the version."""

Seed = Annotated[int, Field(ge=0, lt=1 << 32)]


class PolicySource(Frozen):
    """One behavior policy of a recipe, and its share of the joint steps."""

    later_fields: ClassVar[tuple[str, ...]] = ("convention", "opponents")

    label: Label  # unique in the recipe, such as "expert-0"
    name: Label  # registered policy
    checkpoint: FileName | None = None  # in the package's `checkpoints` or the dataset's
    sha256: Sha256 | None = None  # of that file
    noise: Deviation = 0.0  # standard deviation of the Gaussian action noise
    share: Positive = 1.0  # relative share of the joint steps
    convention: Label | None = None  # of a scripted team (`behavior_policies.coop_nav_controller`)
    opponents: "tuple[PolicySource, ...]" = ()
    """Who plays the sides after the first one, labelled as these are; empty: this policy does."""

    @model_validator(mode="after")
    def _check_opponents(self) -> Self:
        for each in self.opponents:
            if each.opponents or each.share != 1:
                raise ValueError(
                    f"the opponent {each.label} has a share or opponents of its own, expected "
                    "neither"
                )
        return self

    @property
    def acting(self) -> "tuple[PolicySource, ...]":
        """The policies of all sides."""
        return (self, *self.opponents)

    @property
    def title(self) -> str:
        """The names of the policies that play."""
        return " against ".join(each.name for each in self.acting)


def who_acts(policies: Iterable[PolicySource]) -> Iterator[PolicySource]:
    """The policies of all sides."""
    return chain.from_iterable(policy.acting for policy in policies)


def _unique_labels(policies: tuple[PolicySource, ...]) -> tuple[PolicySource, ...]:
    if twice := repeated(policy.label for policy in policies):
        raise ValueError(f"labels must be unique, got several {', '.join(twice)}")
    return policies


Policies = Annotated[
    tuple[PolicySource, ...],
    Field(min_length=1, max_length=MOST_POLICIES),
    AfterValidator(_unique_labels),
]
"""The policies of a dataset; `episodes/policy` has their indices."""


class Splits(Frozen):
    """Episodes of each split in every block of `block` consecutive episodes of one policy."""

    block: Annotated[int, Field(ge=3, le=1_000_000)] = 20  # episodes
    validation: Count = 1  # of them to validation
    test: Count = 1  # of them to test

    @model_validator(mode="after")
    def _check_rest(self) -> Self:
        if self.validation + self.test >= self.block:
            raise ValueError(
                f"validation ({self.validation}) + test ({self.test}) must be less than block "
                f"({self.block}), so that every block has train episodes"
            )
        return self


class SplitRule(NamedTuple):
    """How the episodes of a dataset are split: the sizes of the splits and the seed of the draw."""

    splits: Splits
    seed: int


class Recipe(Frozen):
    """Everything needed to generate a dataset again, bit for bit.

    Each policy has its own stream of episodes, cut into parts of `part_episodes` episodes; part k
    of a policy is a pure function of the recipe and k. The dataset repeatedly takes the next
    episode of the policy that lags most behind its share of the steps, until it has at least
    `n_steps` joint steps. So a recipe with fewer steps gives a prefix of the same dataset.
    """

    later_fields: ClassVar[tuple[str, ...]] = ("metadata",)
    kind: ClassVar[str] = "recipe"  # in no JSON: recipes are older than other origins
    can_rebuild: ClassVar[bool] = True
    missing: ClassVar[None] = None
    source: ClassVar[str] = "this recipe"
    source_sha256: ClassVar[None] = None
    parents: ClassVar[tuple[()]] = ()
    about_tier: ClassVar[None] = None
    remaking: ClassVar[None] = None
    has_world_seeds: ClassVar[bool] = True

    id: Id  # words joined by -, and the version
    tier: Label  # name of the data's quality, for the card
    spec: TaskSpec  # the task
    policies: Policies  # who acts, and how much
    seed: Seed = 0  # of the episodes
    n_steps: Annotated[int, Field(ge=1, le=10**12)] = 1_000_000  # least joint steps
    part_episodes: Annotated[int, Field(ge=1, le=1 << 16)] = 256
    """Episodes that a worker makes at a time."""
    splits: Splits = Splits.defaults()  # shares of train, validation and test
    metadata: dict[Text, Text] = Field(default_factory=dict)  # author, license and so on

    @model_validator(mode="after")
    def _check_part(self) -> Self:
        others = [side.name for side in self.spec.sides[1:]]
        for policy in self.policies:
            named = [each.label for each in policy.opponents]
            if named and named != others:
                raise ValueError(
                    f"policy {policy.label} has opponents for the sides {', '.join(named)}, "
                    f"expected {', '.join(others) or 'none: the task has one side'}"
                )
        if problem := part_excess(self.spec, self.part_episodes):
            raise ValueError(problem)
        return self

    def __hash__(self) -> int:
        """Of the id, which hardly two recipes share; `hash` is that of the whole content."""
        return hash(self.id)

    @property
    def license(self) -> str:
        """The one its author gave it; `registry.published.license_of` knows the package's own."""
        return self.metadata.get("license", "unknown")

    @property
    def recipe(self) -> "Recipe":
        return self

    @property
    def split_rule(self) -> SplitRule:
        return SplitRule(self.splits, self.seed)
