"""Recording, a dataset of steps that were taken in an environment, here or elsewhere."""

from typing import ClassVar, Literal

from pydantic import Field

from swarmdata.specs.frozen import Frozen
from swarmdata.specs.origins.spec_kinds import AnySpec
from swarmdata.specs.plain_names import Label, Sha256, Text
from swarmdata.specs.recipe import Id, Policies, Seed, SplitRule, Splits

NUMBERED_SEEDS = {"seeds": "numbers of the episodes"}
"""Metadata of imported data, which know no seeds."""


class Recording(Frozen):
    """A dataset of steps that were taken in an environment; it cannot be made again."""

    can_rebuild: ClassVar[bool] = False
    missing: ClassVar[None] = None
    recipe: ClassVar[None] = None
    parents: ClassVar[tuple[()]] = ()
    has_world_seeds: ClassVar[bool] = False  # a source may have seeds that its worlds never saw
    remaking: ClassVar[None] = None  # what was recorded is at hand only once
    about_tier: ClassVar[str] = (
        "Recorded step by step in an environment. The table of behavior policies below repeats "
        "what the author said of them."
    )

    kind: Literal["recording"] = "recording"
    id: Id
    tier: Label = "recorded"
    spec: AnySpec
    policies: Policies  # their shares have no meaning
    seed: Seed = 0  # of the splits
    splits: Splits | None = Splits.defaults()  # None: each episode keeps the split of its source
    source: Text  # "recorder", or the format it was converted from
    source_sha256: Sha256 | None = None  # of the file that was converted
    metadata: dict[Text, Text] = Field(default_factory=dict)  # author, license and so on

    @property
    def split_rule(self) -> SplitRule | None:
        return None if self.splits is None else SplitRule(self.splits, self.seed)

    @property
    def license(self) -> str:
        return self.metadata.get("license", "unknown")
