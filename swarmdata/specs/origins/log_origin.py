"""ImportedLogs, a dataset made of the logs of robots."""

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from swarmdata.specs.frozen import Frozen
from swarmdata.specs.origins.log_map import LogMap
from swarmdata.specs.origins.spec_kinds import AnySpec
from swarmdata.specs.plain_names import Label, Name, Sha256, Text
from swarmdata.specs.recipe import Id, Policies, Seed, SplitRule, Splits


class LogFile(Frozen):
    """One log, and what it held; a bag of several files is one log."""

    name: Text
    sha256: Sha256


class EstimatedClock(Frozen):
    """By how much a robot's commands were shifted: their clock was another than that of poses."""

    robot: Name
    offset: float  # s, added to the times of its commands
    uncertainty: Annotated[float, Field(ge=0)]  # s, standard error of the offset
    explained: Annotated[float, Field(le=1)]  # share of the motion's variance that commands explain


class ImportedLogs(Frozen):
    """A dataset made of logs of robots by a map; the same logs and map give it again."""

    later_fields: ClassVar[tuple[str, ...]] = ("clocks",)

    can_rebuild: ClassVar[bool] = False
    missing: ClassVar[None] = None
    recipe: ClassVar[None] = None  # none generates what robots did
    parents: ClassVar[tuple[()]] = ()
    has_world_seeds: ClassVar[bool] = False  # the numbers of the episodes take their place
    source_sha256: ClassVar[None] = None  # every log has a digest of its own

    kind: Literal["logs"] = "logs"
    id: Id
    tier: Label = "logged"
    spec: AnySpec
    policies: Policies
    seed: Seed = 0  # of the splits
    splits: Splits = Splits.defaults()
    files: Annotated[tuple[LogFile, ...], Field(min_length=1)]
    log_map: LogMap
    clocks: tuple[EstimatedClock, ...] = ()  # that the map asked to estimate
    metadata: dict[Text, Text] = Field(default_factory=dict)  # of the author and of the import

    @property
    def split_rule(self) -> SplitRule:
        return SplitRule(self.splits, self.seed)

    @property
    def source(self) -> str:
        return "logs of robots, " + ", ".join(
            f"{file.name} (SHA-256 {file.sha256})" for file in self.files
        )

    @property
    def remaking(self) -> str:
        return (
            "The same logs give this dataset again, with the same digest: "
            "`swarmdata import LOG... --map recipe.json --out FOLDER`, with the file beside this "
            "card."
        )

    @property
    def license(self) -> str:
        return self.metadata.get("license", "unknown")

    @property
    def about_tier(self) -> str:
        text = (
            f"Logged by robots and resampled to steps of {self.log_map.dt:g} s: positions "
            "linearly, headings on the circle, each command held until the next. "
        )
        guessed = [robot.name for robot in self.log_map.robots if robot.command.differences]
        if guessed:
            text += (
                f"**The actions of {', '.join(guessed)} are no commands**: none were logged, and "
                "they are finite differences of the poses. "
            )
        for clock in self.clocks:
            text += (
                f"The clock of {clock.robot}'s commands was estimated by the motion that follows: "
                f"{clock.offset:.3f} ± {clock.uncertainty:.3f} s were added to their times. "
            )
        if self.spec.world is not None:
            return text + (
                "Rewards, events and ends were computed from the logged poses by the functions of "
                "the task. Contacts are overlaps of the logged positions, and velocities are "
                "differences of positions. "
            )
        return text + "Gaps are masked: where a robot's pose or command is not known, it is absent."
