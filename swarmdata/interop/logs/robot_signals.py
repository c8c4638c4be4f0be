"""RobotSignals: what a map says of one robot, read as samples in SI units and in the world."""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from copy import copy
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmdata.errors import ConversionError
from swarmdata.interop.logs.open_logs import OpenLogs
from swarmdata.interop.logs.planar_frames import PlanarFrames, yaw_of
from swarmdata.interop.logs.resampling import NANOSECONDS, Samples, nanoseconds
from swarmdata.specs.origins.log_map import (
    UNITS,
    CodeOf,
    ColumnOf,
    CommandSignal,
    FeatureSignal,
    GoalSignal,
    LoggedRobot,
    LogSource,
    MarkerSignal,
    PoseSignal,
    RewardSignal,
    ScanSignal,
    Signal,
    Slots,
)
from swarmdata.specs.plain_names import repeated
from swarmdata.types import Bool, Double, Int

DEFAULT_TIME = ColumnOf(column="time")

SCAN_ANGLES = ("angle_min", "angle_increment")
"""Columns of the angle of a scan's first beam, and of that between beams, as LaserScan has them."""

POSITION, ANGLE = ("length", "m"), ("angle", "rad")

MOST_TURNS = 25.0
"""Radians that headings without a unit may have: four turns. More are rather degrees."""


@dataclass(frozen=True, slots=True, eq=False)
class RobotSignals:
    """The samples of one robot; a signal that the map does not name is None."""

    robot: LoggedRobot
    positions: Samples  # x, y in the world, m
    headings: Samples  # in the world, rad
    commands: Samples | None  # components in SI units; None: differences of the poses
    goals: Samples | None  # x, y in the world, m
    scans: Samples | None  # ranges, m
    features: tuple[tuple[Samples, ...], ...]  # of each, one for each of its slots
    rewards: Samples | None


class SignalReader:
    """Reads signals of open logs; time may run back by `max_gap` s."""

    def __init__(self, logs: OpenLogs, frames: PlanarFrames, max_gap: float) -> None:
        self._logs, self._frames, self._max_gap = logs, frames, max_gap
        # rows that were put in order, and that repeat the time of another, by what they are
        self.counts: Counter[str] = Counter()

    def robot(self, robot: LoggedRobot) -> RobotSignals:
        """Everything that a map says of a robot; ConversionError for a wrong column or unit."""
        positions, headings = self._poses(robot, robot.pose)
        is_logged = not robot.command.differences
        return RobotSignals(
            robot=robot,
            positions=positions,
            headings=headings,
            commands=self._commands(robot, robot.command) if is_logged else None,
            goals=None if robot.goal is None else self._goals(robot, robot.goal),
            scans=None if robot.scan is None else self._scans(robot, robot.scan),
            features=tuple(tuple(self._feature(robot, each)) for each in robot.features),
            rewards=None if robot.reward is None else self._rewards(robot, robot.reward),
        )

    def marker(self, marker: MarkerSignal) -> Samples:
        """A column of markers; texts become the numbers of their values, in order."""
        rows = _Rows(self._logs, None, marker, "marker of episodes")
        cells = rows.texts(marker.column)
        codes = {text: code for code, text in enumerate(dict.fromkeys(cells))}
        return self._samples(rows, [np.array([codes[text] for text in cells], np.float64)])

    def _poses(self, robot: LoggedRobot, pose: PoseSignal) -> tuple[Samples, Samples]:
        rows = _Rows(self._logs, robot, pose, f"pose of {robot.name}")
        if pose.quaternion is None:
            heading = rows.quantity(pose.heading, ANGLE)
            if pose.heading.unit is None and np.abs(heading).max(initial=0.0) > MOST_TURNS:
                raise ConversionError(
                    f"headings of the {rows.what} run from {heading.min():.4g} to "
                    f"{heading.max():.4g}, which as radians are several turns. Say in the map "
                    "which unit they have: `unit: deg`, or `unit: rad`"
                )
        else:
            heading = yaw_of(*(rows.quantity(ColumnOf(column=c)) for c in pose.quaternion))
        columns = [*(rows.quantity(each, POSITION) for each in (pose.x, pose.y)), heading]
        samples = self._samples(rows, columns)
        frame, what = pose.frame or rows.table.frame, f"poses of {robot.name}"
        positions = Samples(samples.times, samples.values[:, :2])
        _, _, turn = self._frames.pose_of(frame, what)
        headings = Samples(samples.times, samples.values[:, 2:] + turn)
        return self._frames.points(positions, frame, what), headings

    def _commands(self, robot: LoggedRobot, command: CommandSignal) -> Samples:
        rows = _Rows(self._logs, robot, command, f"command of {robot.name}")
        samples = self._samples(rows, [rows.quantity(each) for each in command.components])
        offset = command.clock_offset
        return samples if offset == "estimate" else samples.shifted(nanoseconds(offset))

    def _goals(self, robot: LoggedRobot, goal: GoalSignal) -> Samples:
        rows = _Rows(self._logs, robot, goal, f"goal of {robot.name}")
        samples = self._samples(rows, [rows.quantity(each, POSITION) for each in (goal.x, goal.y)])
        frame = goal.frame or rows.table.frame
        return self._frames.points(samples, frame, f"goals of {robot.name}")

    def _scans(self, robot: LoggedRobot, scan: ScanSignal) -> Samples:
        rows = _Rows(self._logs, robot, scan, f"scan of {robot.name}")
        names = [name for each in scan.columns for name in rows.table.matching(each) or [each]]
        ranges = rows.arrays([ColumnOf(column=name, unit=scan.unit) for name in names], POSITION)
        angles = None
        if all(name in rows.table.cells for name in SCAN_ANGLES):
            start, step = (rows.quantity(ColumnOf(column=name), ANGLE) for name in SCAN_ANGLES)
            angles = start, step
        return self._samples(rows, [clean_scans(ranges, scan, robot.name, angles)])

    def _feature(self, robot: LoggedRobot, feature: FeatureSignal) -> Iterator[Samples]:
        what = f"feature {feature.name} of {robot.name}"
        wanted = ANGLE if feature.between == "angle" else None
        for rows in _Rows(self._logs, robot, feature, what).in_slots(self._logs, feature.slots):
            yield self._samples(rows, [rows.quantity(feature.column, wanted)])

    def _rewards(self, robot: LoggedRobot, reward: RewardSignal) -> Samples:
        rows = _Rows(self._logs, robot, reward, f"reward of {robot.name}")
        return self._samples(rows, [rows.quantity(reward.column)], is_summed=reward.over == "sum")

    def _samples(
        self, rows: "_Rows", columns: Iterable[NDArray[Any]], *, is_summed: bool = False
    ) -> Samples:
        """Rows with values by time; of those at the same time the last, or the sum."""
        values: Double = np.concatenate([np.atleast_2d(each.T).T for each in columns], axis=1)
        times = rows.times()
        if (np.abs(values) > np.finfo(np.float32).max).any():
            raise ConversionError(f"the {rows.what} ({rows.table.name}) has infinite values")
        rows.check_order(times, self._max_gap)
        whole = ~np.isnan(values).any(axis=1)
        times, values = times[whole], values[whole]
        order = np.argsort(times, kind="stable")
        self.counts["reordered_rows"] += int((np.diff(times) < 0).sum())
        times, values = times[order], values[order]
        last = np.append(np.diff(times) > 0, True)[: len(times)]
        self.counts["repeated_rows"] += int((~last).sum())
        if is_summed and len(times):
            values = np.add.reduceat(values, np.flatnonzero(np.append(True, last[:-1])))
            return Samples(times[last], values)
        return Samples(times[last], values[last])


class _Rows:
    """The rows of one signal; a robot's source holds where the signal's says nothing."""

    def __init__(
        self, logs: OpenLogs, robot: LoggedRobot | None, source: LogSource, what: str
    ) -> None:
        names = ("log", "topic", "rows", "time")
        log, topic, wanted, time = (
            getattr(source if robot is None or getattr(source, name) is not None else robot, name)
            for name in names
        )
        self.what, self.table, self._time = what, logs.table(log, topic, what), time or DEFAULT_TIME
        self._max_gap = source.max_gap if isinstance(source, Signal) else None
        self._offset = 0 if robot is None else nanoseconds(robot.clock_offset)
        self._chosen: Bool = np.ones(self.table.n_rows, np.bool_)
        for column, value in (wanted or {}).items():
            is_code = isinstance(value, CodeOf)
            text = _look_up(logs, value, what) if isinstance(value, CodeOf) else value
            self._chosen &= self.table.rows_with(column, text, may_lack=is_code)

    def in_slots(self, logs: OpenLogs, slots: Slots | None) -> "Iterator[_Rows]":
        """The rows of each slot; all rows, if there are none."""
        if slots is None:
            yield self
            return
        values = logs.table(slots.log, None, self.what).texts(slots.column)
        if twice := repeated(values):
            raise ConversionError(
                f"{slots.log} lists {', '.join(twice)} several times in column {slots.column!r}, "
                f"expected one slot each for the {self.what}"
            )
        for value in values:
            slot = copy(self)
            slot._chosen = self._chosen & self.table.rows_with(slots.of, value, may_lack=True)
            yield slot

    def texts(self, column: str) -> list[str]:
        cells = self.table.texts(column)
        return [cells[k] for k in np.flatnonzero(self._chosen)]

    def quantity(self, column: ColumnOf, wanted: tuple[str, str] | None = None) -> Double:
        """A column in SI units, of a quantity if one is wanted, [n] or [n, B]."""
        values = self.table.numbers(column.column)[self._chosen]
        if wanted and values.dtype == np.bool_:
            raise ConversionError(
                f"the {self.what} has true and false in column {column.column!r}, expected a "
                f"{wanted[0]}"
            )
        factor = self._factor(column, wanted)
        return np.asarray(values if factor == 1 else values * factor, np.float64)

    def arrays(self, columns: Sequence[ColumnOf], wanted: tuple[str, str]) -> list[Double]:
        """Columns in SI units, joined, as one array for each row, of one or several lengths."""
        parts = [self.table.arrays(column.column) for column in columns]
        factors = [self._factor(column, wanted) for column in columns]
        return [
            np.concatenate([part[k] * factor for part, factor in zip(parts, factors, strict=True)])
            for k in np.flatnonzero(self._chosen)
        ]

    def times(self) -> Int:
        """The times of the rows, on the clock of the map, [n] ns."""
        unit = self._unit(self._time, "s")
        if UNITS[unit][0] != "time":
            raise ConversionError(
                f"the times of the {self.what} have the unit {unit}, expected s, ms, us or ns"
            )
        return self.table.nanoseconds(self._time.column, unit)[self._chosen] + self._offset

    def check_order(self, times: Int, max_gap: float) -> None:
        """Refuses rows whose times run back by more than `max_gap` s, or that of the signal."""
        behind = np.maximum.accumulate(times) - times
        allowed = self._max_gap or max_gap
        wrong = np.flatnonzero(behind > nanoseconds(allowed))
        if len(wrong):
            row = int(np.flatnonzero(self._chosen)[wrong[0]]) + 1
            raise ConversionError(
                f"{self.table.name}, row {row:,}: time runs back by "
                f"{behind[wrong[0]] / NANOSECONDS:g} s, more than `max_gap` ({allowed:g} s), in "
                f"the {self.what}. Two drives are in one log, or its clock was set: split the log "
                "there. If it is one drive, sort its rows, or take `time: log_time` of a bag"
            )

    def _factor(self, column: ColumnOf, wanted: tuple[str, str] | None) -> float:
        """Size of a column's unit in SI units."""
        unit = self._unit(column, wanted[1] if wanted else "1")
        if wanted and UNITS[unit][0] != wanted[0]:
            raise ConversionError(
                f"the {self.what} has the unit {unit} in column {column.column!r}, expected a "
                f"unit of {wanted[0]} such as {wanted[1]}"
            )
        return UNITS[unit][1] * (column.scale or 1.0)

    def _unit(self, column: ColumnOf, default: str) -> str:
        fixed = self.table.units.get(column.column)
        if fixed and column.unit and fixed != column.unit:
            raise ConversionError(
                f"the {self.what} has the unit {column.unit} in column {column.column!r}, whose "
                f"unit in {self.table.name} is {fixed}; leave it out"
            )
        return column.unit or fixed or default


def _look_up(logs: OpenLogs, code: CodeOf, what: str) -> str:
    """The value that another table has."""
    table = logs.table(code.log, None, what)
    chosen = np.ones(table.n_rows, np.bool_)
    for column, value in code.rows.items():
        chosen &= table.rows_with(column, value)
    if chosen.sum() != 1:
        raise ConversionError(
            f"{table.name} has {chosen.sum()} rows with {code.rows}, expected one for the {what}"
        )
    return table.texts(code.column)[int(np.argmax(chosen))]


def clean_scans(
    rows: Sequence[Double], scan: ScanSignal, name: str, angles: tuple[Double, Double] | None = None
) -> Double:
    """Ranges in [range_min, range_max], the smallest of each sector; unknown scans are NaN.

    REP 117 of ROS: `inf` is nothing in range, `-inf` too near to measure, NaN an invalid range. The
    sectors divide the field of view of the first scan. A scan without beams is unknown.

    Args:
        rows: ranges of each scan as they were logged, m, [B] each.
        scan: what the map says of them.
        name: of the robot, for errors.
        angles: of the first beam of each scan, and between its beams, rad, [n] each; None, or 0
            between beams: every scan has the same beams.

    Returns:
        [n, sectors], or [n, B] where the map names no sectors.
    """
    sizes = {len(row) for row in rows if len(row)}
    if not sizes:
        raise ConversionError(f"the scans of {name} have no beams")
    if scan.beams is None and len(sizes) > 1:
        raise ConversionError(
            f"scans of {name} have {min(sizes)} to {max(sizes)} beams; say into how many sectors "
            "they are divided, `beams` of the map"
        )
    n_sectors = scan.beams or max(sizes)
    if n_sectors > max(sizes):
        raise ConversionError(
            f"scans of {name} have {max(sizes)} beams, too few for {n_sectors} sectors; choose "
            "fewer `beams`"
        )
    found = np.full((len(rows), n_sectors), np.inf)
    places = _sectors(rows, n_sectors, angles if scan.beams else None, name)
    for row, ranges, sectors in zip(found, rows, places, strict=True):
        with np.errstate(invalid="ignore"):  # a sector with an unknown beam is unknown
            np.minimum.at(row, sectors, _valid(ranges, scan))
        if not len(ranges):
            row[:] = np.nan
    found[np.isinf(found)] = np.nan if scan.invalid == "unknown" else scan.range_max  # no beam
    return found


def _sectors(
    rows: Sequence[Double], n_sectors: int, angles: tuple[Double, Double] | None, name: str
) -> Iterator[Int]:
    """The sector of every beam of each scan, [B] each."""
    sizes = np.array([len(row) for row in rows])
    first = int(np.argmax(sizes > 0))
    n_beams = int(sizes[first])
    is_alike = bool(np.isin(sizes, (0, n_beams)).all())
    if angles is None or not (np.isfinite(angles).all() and angles[1][sizes > 0].all()):
        if not is_alike:
            raise ConversionError(
                f"scans of {name} differ in their number of beams, and no columns say at which "
                "angles these are (`angle_min` and `angle_increment` of a LaserScan)"
            )
        angles = np.zeros(len(rows)), np.ones(len(rows))
    starts, steps = angles  # rad, or beams
    low, width = starts[first] - steps[first] / 2, steps[first] * n_beams
    is_circle = abs(width) > 2 * np.pi - 1.5 * abs(steps[first])
    for k, size in enumerate(sizes.tolist()):
        places = (starts[k] + steps[k] * np.arange(size) - low) / width
        if is_circle:
            places %= 1.0
        elif size and max(-places.min(), places.max() - 1) > 1 / n_beams:
            raise ConversionError(
                f"scan {k + 1} of {name} has beams outside the field of view of the first one"
            )
        yield np.floor(places * n_sectors).astype(np.int64).clip(0, n_sectors - 1)


def _valid(ranges: Double, scan: ScanSignal) -> Double:
    """Ranges, of which those that are not known are NaN."""
    invalid = np.isnan(ranges) | (ranges < scan.range_min)
    found: Double = np.where(invalid, scan.range_max, ranges).clip(max=scan.range_max)
    if scan.invalid == "unknown":
        found[invalid] = np.nan
    return found
