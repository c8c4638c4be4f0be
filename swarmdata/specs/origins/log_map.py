"""LogMap, where in the logs of robots a dataset's columns are, as a YAML file says it."""

import math
from collections.abc import Iterator, Mapping
from typing import Annotated, Any, ClassVar, Literal, Self, get_args

from pydantic import BeforeValidator, Field, model_validator

from swarmdata.specs.frozen import Frozen, Positive
from swarmdata.specs.plain_names import Label, Name, Text, repeated
from swarmdata.specs.quantities import Length

UNITS: Mapping[str, tuple[str, float]] = {
    "m": ("length", 1.0), "cm": ("length", 1e-2), "mm": ("length", 1e-3), "km": ("length", 1e3),
    "px": ("length", 1.0),
    "rad": ("angle", 1.0), "deg": ("angle", math.pi / 180),
    "s": ("time", 1.0), "ms": ("time", 1e-3), "us": ("time", 1e-6), "ns": ("time", 1e-9),
    "m/s": ("speed", 1.0), "cm/s": ("speed", 1e-2), "mm/s": ("speed", 1e-3),
    "rad/s": ("turn rate", 1.0), "deg/s": ("turn rate", math.pi / 180),
    "1": ("number", 1.0),
}  # fmt: skip
"""Quantity and size in SI units of each unit that a map may name; of pixels, `scale` says it."""

Unit = Literal[
    "m", "cm", "mm", "km", "px", "rad", "deg", "s", "ms", "us", "ns",
    "m/s", "cm/s", "mm/s", "rad/s", "deg/s", "1",
]  # fmt: skip

BODY_DIFFERENCES, WORLD_DIFFERENCES = ("v", "vy", "omega"), ("vx", "vy", "omega")
"""Commands that finite differences of poses give, in the robot's frame and in the world's."""

Motion = Literal["v", "vx", "vy", "omega"]
"""Forward speed, speed along an axis, sideways where that is the robot's, and turn rate."""

Finite = Annotated[float, Field(ge=-1e12, le=1e12, allow_inf_nan=False)]

ClockOffset = Annotated[float, Field(ge=-1e9, le=1e9)]


class ColumnOf(Frozen):
    """One column of a table, or one field of a message such as `pose.position.x`."""

    later_fields: ClassVar[tuple[str, ...]] = ("scale",)

    column: Text  # its name
    unit: Unit | None = None  # none: as the format says, else metres, radians, seconds
    scale: Finite | None = None  # factor; of a pixel its metres, negative where y points down

    @model_validator(mode="after")
    def _check_scale(self) -> Self:
        if self.scale == 0 or (self.unit == "px" and self.scale is None):
            raise ValueError(
                f"unit is {self.unit or 'not given'} and scale {self.scale}: pixels (unit: px) "
                "need the metres of one as their scale, and no scale is 0"
            )
        return self


ColumnOrName = Annotated[
    ColumnOf, BeforeValidator(lambda given: {"column": given} if isinstance(given, str) else given)
]
"""A column, of which the name alone may be given."""


class CodeOf(Frozen):
    """A value that another table has, such as the barcode of a robot."""

    log: Text  # file name of the table
    rows: dict[Text, Text | int]  # of that table; one row has these values
    column: Text  # that holds the value


class LogSource(Frozen):
    """Where a signal is. What a signal leaves out is that of its robot."""

    log: Text | None = None  # file name of the log; none: the only one
    topic: Text | None = None  # of a bag; a table has none
    rows: dict[Text, Text | int | CodeOf] | None = None  # only rows with these values, by column
    time: ColumnOrName | None = None  # none: the column `time`


class Signal(LogSource):
    """A signal that is unknown where its samples are too far apart."""

    max_gap: Positive | None = None  # s; none: that of the map


class PoseSignal(Signal):
    """Poses of a robot in the plane."""

    x: ColumnOrName = ColumnOf(column="x")  # position
    y: ColumnOrName = ColumnOf(column="y")  # likewise
    heading: ColumnOrName = ColumnOf(column="heading")  # counter-clockwise from the x axis
    quaternion: tuple[Text, Text, Text, Text] | None = None  # columns of x, y, z, w, for a heading
    frame: Text | None = None  # of the poses; none: that of the messages, else the world


class CommandComponent(ColumnOf):
    """One component of a command, with its bounds in SI units."""

    later_fields: ClassVar[tuple[str, ...]] = (*ColumnOf.later_fields, "motion")

    low: Finite | None = None  # least value, in SI units; none: the least that any robot logged
    high: Finite | None = None  # greatest value, likewise
    motion: Motion | None = None  # what it commands; none: what its column is named after, if that

    @property
    def commands(self) -> Motion | None:
        """What it commands; None where neither the map nor the column's name says it."""
        names: tuple[Motion, ...] = get_args(Motion)
        return self.motion or next((name for name in names if name == self.column), None)

    @model_validator(mode="after")
    def _check_order(self) -> Self:
        if (self.low is None) != (self.high is None):
            raise ValueError("low and high: give both, or neither")
        if self.low is not None and self.high is not None and self.low >= self.high:
            raise ValueError(f"low is {self.low:g}, expected less than high ({self.high:g})")
        return self


class CommandSignal(Signal):
    """Commands of a robot, each held until the next one: the actions of the dataset."""

    later_fields: ClassVar[tuple[str, ...]] = ("clock_offset",)

    components: Annotated[tuple[CommandComponent, ...], Field(min_length=1, max_length=64)]
    """Of the action, in order."""
    frame: Literal["body", "world"] = "body"  # of the components
    differences: bool = False  # computed of the poses, because no commands were logged
    outside: Literal["refuse", "clip"] = "refuse"  # commands beyond their bounds
    clock_offset: ClockOffset | Literal["estimate"] = 0.0
    """s, added to their times beside the robot's; `estimate`: found by the motion that follows."""

    @model_validator(mode="after")
    def _check_components(self) -> Self:
        known = BODY_DIFFERENCES if self.frame == "body" else WORLD_DIFFERENCES
        names = [each.column for each in self.components]
        if self.clock_offset == "estimate" and self.differences:
            raise ValueError("clock_offset: estimate needs logged commands, not differences")
        is_known = any(each.commands in known for each in self.components)
        if self.clock_offset == "estimate" and not is_known:
            raise ValueError(
                "clock_offset: estimate needs to know what is commanded: say `motion` of a "
                f"component, in the frame {self.frame} one of {', '.join(known)}"
            )
        if twice := repeated(names):
            raise ValueError(f"several components are of the column {', '.join(twice)}")
        if self.differences and any(each.low is None for each in self.components):
            raise ValueError("differences need bounds: say low and high of every component")
        if self.differences and (wrong := [name for name in names if name not in known]):
            raise ValueError(
                f"differences in the frame {self.frame} give {', '.join(known)}, not "
                f"{', '.join(wrong)}"
            )
        return self


class GoalSignal(LogSource):
    """Goals of a robot, each held until the next one, however long that takes."""

    x: ColumnOrName = ColumnOf(column="x")  # position
    y: ColumnOrName = ColumnOf(column="y")  # likewise
    frame: Text | None = None  # of the goals; none: that of the messages, else the world


class ScanSignal(Signal):
    """Ranges of a robot's scanner; `inf` and more than `range_max` is nothing in range."""

    columns: Annotated[tuple[Text, ...], Field(min_length=1)] = ("ranges",)
    """Columns in order; `scan_*` stands for all that begin so, in the order of the table."""
    unit: Unit = "m"  # of the ranges
    range_min: Annotated[float, Field(ge=0, le=1e6)] = 0.0  # m; smaller ranges are invalid
    range_max: Positive  # m; what is farther is out of range
    beams: Annotated[int, Field(ge=1, le=100_000)] | None = None
    """Sectors to keep, of each the smallest range; none: every beam."""
    invalid: Literal["unknown", "nothing"] = "unknown"
    """What a beam means that is no number or too near: a scan of which nothing is known, or
    nothing in range."""


class Slots(Frozen):
    """A table that lists the values of a column, such as the barcodes of all landmarks."""

    of: Text  # the column of the feature's log
    log: Text  # file name of the table
    column: Text  # of the table, that lists them


class FeatureSignal(Signal):
    """A further column, for observations."""

    later_fields: ClassVar[tuple[str, ...]] = ("slots",)

    name: Name  # of the entry in observations
    column: ColumnOrName  # that holds it
    between: Literal["linear", "held", "angle"] = "linear"  # samples; angles become cosine and sine
    slots: Slots | None = None  # one for each of these values, in their order; none: all rows


class RewardSignal(LogSource):
    """Rewards of a robot, in a column."""

    column: ColumnOrName = ColumnOf(column="reward")  # that holds them
    over: Literal["sum", "held"] = "sum"  # of a step: the sum of its rows, or the value before it


class LoggedRobot(LogSource):
    """One robot; `{robot}` in any text is its name. What it says of logs holds for its signals."""

    name: Name  # unique in the team
    clock_offset: ClockOffset = 0.0  # s, added to its times
    pose: PoseSignal = PoseSignal.defaults()  # where it was
    command: CommandSignal  # what it was told to do
    goal: GoalSignal | None = None  # where it should go, if that was logged
    scan: ScanSignal | None = None  # what its scanner measured, if it had one
    features: tuple[FeatureSignal, ...] = ()  # what else it observes
    reward: RewardSignal | None = None  # none: rewards are 0

    @model_validator(mode="after")
    def _check_names(self) -> Self:
        fixed = [name for name in ("pose", "goal", "scan") if getattr(self, name) is not None]
        names = [*fixed, *(feature.name for feature in self.features)]
        if twice := repeated(name for each in names for name in (each, f"{each}_known")):
            raise ValueError(f"{', '.join(twice)} is the name of several signals of {self.name}")
        return self


class StaticTransform(Frozen):
    """A frame that stands still in its parent: where its origin is, and how it is turned."""

    frame: Text  # its name
    parent: Text  # the frame that it stands in
    x: Finite = 0.0  # m, of its origin in the parent
    y: Finite = 0.0  # m, likewise
    heading: Finite = 0.0  # rad, counter-clockwise


class WindowRows(Frozen):
    """Rows that are windows: each has the columns of several steps, one step after the other."""

    columns: Annotated[Text, Field(pattern=r"\{step\}.*\{column\}|\{column\}.*\{step\}")]
    """How their names are made, such as `{step}_{column}` of `0_x`, `0_y`, `1_x`, `1_y`."""
    step: Positive  # s, between two steps
    pause: Positive  # s, from the end of a window to the next one's begin; more than any `max_gap`


class TableForm(Frozen):
    """How text tables are written."""

    later_fields: ClassVar[tuple[str, ...]] = ("windows",)

    delimiter: Annotated[str, Field(pattern=r"^(.|\t|whitespace)$")] = ","
    """One character, or `whitespace` for any number of spaces and tabs."""
    header: tuple[Text, ...] | None = None  # names of the columns; none: the first line has them
    comment: Annotated[str, Field(max_length=8)] = ""  # lines that begin so are left out
    windows: WindowRows | None = None  # none: a row is of one time


class MarkerSignal(LogSource):
    """A column whose value changes where an episode begins."""

    column: Text  # its name


class EpisodeCuts(Frozen):
    """How a log becomes episodes; it is cut wherever nobody acts, too."""

    later_fields: ClassVar[tuple[str, ...]] = ("goals",)

    marker: MarkerSignal | None = None  # cut where this column changes
    goal_change: Positive | None = None  # m; cut where a goal moves farther than this
    length: Positive | None = None  # s; most of an episode
    min_steps: Annotated[int, Field(ge=1, le=10**9)] = 2  # shorter ones are left out, and counted
    ends: Literal["truncation", "termination"] = "truncation"  # at markers and changes of goals
    goals: Literal["logged", "reached"] = "logged"
    """For a task that scores the logs; reached: where each robot is when its episode is cut."""


class LoggedObstacle(Frozen):
    """An obstacle that stood in the arena all the time, in the frame `world`."""

    shape: Literal["circle", "box"]  # a disc, or a rectangle
    x: Finite  # m, of its centre
    y: Finite  # m, likewise
    heading: Finite = 0.0  # rad, of a box's length, counter-clockwise from the x axis
    half_length: Length  # m, of a box; the radius of a circle
    half_width: Length | None = None  # m, of a box

    @model_validator(mode="after")
    def _check_width(self) -> Self:
        if (self.shape == "box") != (self.half_width is not None):
            raise ValueError("half_width: a box needs it, a circle has half_length alone")
        return self


class LogMap(Frozen):
    """Which topics and columns of logs are the poses, commands and observations of robots."""

    later_fields: ClassVar[tuple[str, ...]] = ("clock_search", "obstacles", "states")

    dt: Annotated[float, Field(ge=1e-6, le=1e6)]  # s, duration of a step
    robots: Annotated[tuple[LoggedRobot, ...], Field(min_length=1, max_length=1024)]
    """The team, in order; a name alone takes everything from `each`."""
    max_gap: Positive = 0.5  # s; a signal is unknown between samples that are farther apart
    gaps: Literal["mask", "cut"] = "mask"  # a robot with a gap is absent, or the episode is cut
    episodes: EpisodeCuts = EpisodeCuts.defaults()  # where they begin and end
    policy: Label = "logged"  # who commanded
    world: Text = "world"  # frame of the dataset
    transforms: tuple[StaticTransform, ...] = ()  # beside those of the bags
    tables: dict[Text, TableForm] = Field(default_factory=dict)  # by file name, `*` for any text
    ignore: tuple[Text, ...] = ()  # columns that are left out, by name, `*` for any text
    ignore_logs: tuple[Text, ...] = ()  # files of a folder that are left out, likewise
    clock_search: Positive = 5.0  # s; offsets to be estimated are no greater
    obstacles: tuple[LoggedObstacle, ...] = ()  # for a task that scores the logs
    states: Literal["observations", "poses"] = "observations"
    """All observations; or the poses of all robots, which then do not observe their own."""

    @model_validator(mode="before")
    @classmethod
    def _fill_in(cls, content: Any) -> Any:
        """Gives every robot what `each` says, and puts its name in the place of `{robot}`."""
        if not isinstance(content, Mapping) or not isinstance(content.get("robots"), list):
            return content
        rest = {key: value for key, value in content.items() if key != "each"}
        shared = content.get("each", {})
        if not isinstance(shared, Mapping):
            raise ValueError("each: expected a mapping, which holds for every robot")
        robots = [{"name": each} if isinstance(each, str) else each for each in content["robots"]]
        for each in robots:
            if not isinstance(each, Mapping):
                raise ValueError(
                    f"robots: got {each!r:.100}, expected a name, in quotes where it is a number "
                    '("1"), or a mapping with a name'
                )
        rest["robots"] = [_named({**shared, **each}, str(each.get("name", ""))) for each in robots]
        return rest

    @model_validator(mode="after")
    def _check(self) -> Self:
        if twice := repeated(robot.name for robot in self.robots):
            raise ValueError(f"several robots are named {', '.join(twice)}, expected one each")
        if twice := repeated(each.frame for each in self.transforms):
            raise ValueError(f"several transforms place the frame {', '.join(twice)}")
        gaps = [self.max_gap, *(signal.max_gap or 0 for signal in self._signals())]
        for name, form in self.tables.items():
            if form.windows and form.windows.pause <= max(gaps):
                raise ValueError(
                    f"tables of {name}: pause is {form.windows.pause:g} s, expected more than "
                    f"every `max_gap` ({max(gaps):g} s), or windows would be joined"
                )
        has_goals = any(robot.goal for robot in self.robots)
        if self.episodes.goal_change and not has_goals:
            raise ValueError("episodes.goal_change needs the goal of a robot, and there is none")
        if self.episodes.goals == "reached" and has_goals:
            raise ValueError("episodes.goals: reached takes the place of `goal` of the robots")
        return self

    def _signals(self) -> Iterator[Signal]:
        """Every signal that has a gap of its own."""
        for robot in self.robots:
            yield from (robot.pose, robot.command, *robot.features)
            if robot.scan is not None:
                yield robot.scan


def _named(value: Any, name: str) -> Any:
    """The value with a robot's name in every text."""
    if isinstance(value, str):
        return value.replace("{robot}", name)
    if isinstance(value, Mapping):
        return {key: _named(each, name) for key, each in value.items()}
    return [_named(each, name) for each in value] if isinstance(value, list) else value
