"""Offsets of the clocks of commands, estimated by the motion that follows them.

The score of an offset is the squared correlation of the mean command with the mean motion over half
steps, averaged over what is commanded. Its maximum is refined by a parabola, and its standard error
is that of the maxima of eight parts of the log. A robot's reaction time is part of its offset.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from swarmdata.errors import ConversionError
from swarmdata.interop.logs.planar_frames import planar_motion
from swarmdata.interop.logs.resampling import NANOSECONDS, interpolate, nanoseconds, wrap
from swarmdata.interop.logs.robot_signals import RobotSignals
from swarmdata.specs.origins.log_map import LogMap
from swarmdata.specs.origins.log_origin import EstimatedClock
from swarmdata.types import Bool, Double, Int

LEAST_EXPLAINED = 0.2  # least share of the motion's variance that commands explain at the offset
ALMOST_AS_GOOD = 0.9  # offsets whose score is this share of the best one could be right too
LEAST_OVERLAP = 0.3  # least share of the log in which poses and shifted commands are both known
N_PARTS = 8  # parts of the log whose offsets give the standard error


def align_commands(
    signals: Sequence[RobotSignals], log_map: LogMap, known: Sequence[EstimatedClock] | None = None
) -> tuple[list[RobotSignals], tuple[EstimatedClock, ...]]:
    """Shifts commands by the clock offsets that the map asks to estimate, or that are known."""
    found, clocks = [], []
    taken = {clock.robot: clock for clock in known or ()}
    for each in signals:
        if each.robot.command.clock_offset != "estimate" or each.commands is None:
            found.append(each)
            continue
        clock = taken.get(each.robot.name) or estimate_offset(each, log_map)
        clocks.append(clock)
        shifted = each.commands.shifted(nanoseconds(clock.offset))
        found.append(replace(each, commands=shifted))
    return found, tuple(clocks)


def estimate_offset(signals: RobotSignals, log_map: LogMap) -> EstimatedClock:
    """By how much a robot's commands have to be shifted; ConversionError if the data do not say."""
    fit = _Fit.of(signals, log_map)
    name, search, dt = signals.robot.name, log_map.clock_search, log_map.dt
    what = f"the clock offset of the commands of {name} is not determined: "
    if fit is None:
        raise ConversionError(
            f"{what}commands or motion never change while both are known. Log a drive with turns "
            "and stops, or give `clock_offset` in seconds."
        )
    offsets = np.arange(-search, search + dt / 8, dt / 4)
    scores = np.array([fit.score(offset) for offset in offsets])
    best = int(np.argmax(scores))
    if scores[best] < LEAST_EXPLAINED:
        raise ConversionError(
            f"{what}at no offset up to {search:g} s do commands explain more than "
            f"{scores[best]:.0%} of the motion. If the clocks differ by more, give a rough "
            "`clock_offset` of the robot, or raise `clock_search`."
        )
    near = scores >= ALMOST_AS_GOOD * scores[best]
    rivals = offsets[near & ~_run_around(near, best)]
    if near[0] or near[-1] or len(rivals):
        other = f"{rivals[0]:.2f} s" if len(rivals) else f"the end of the search, {search:g} s,"
        raise ConversionError(
            f"{what}{offsets[best]:.2f} s and {other} fit almost alike, as they do if commands "
            "repeat or hardly change. Narrow or widen `clock_search`, or give `clock_offset`."
        )
    offset = fit.refine(offsets[best], dt)
    parts = [part.refine(offset, dt) for part in fit.parts(offset)]
    uncertainty = float(np.std(parts, ddof=1) / np.sqrt(len(parts))) if len(parts) > 1 else np.inf
    if uncertainty > dt / 2:
        raise ConversionError(
            f"{what}parts of the log give offsets whose mean has a standard error of "
            f"{uncertainty:.2f} s, expected at most half a step ({dt / 2:g} s). Log a longer drive "
            "with turns and stops, or give `clock_offset`."
        )
    return EstimatedClock(
        robot=name, offset=round(offset, 6), uncertainty=round(uncertainty, 6),
        explained=round(fit.score(offset), 4),
    )  # fmt: skip


def _run_around(flags: Bool, index: int) -> Bool:
    """The unbroken run of true flags that contains an index."""
    numbers = np.cumsum(np.append(True, flags[1:] != flags[:-1]))
    run: Bool = numbers == numbers[index]
    return run


@dataclass(frozen=True, eq=False)
class _Fit:
    """Measured motion over short intervals, and the commands that may explain it."""

    starts: Double  # [n] s, of intervals with known poses
    length: float  # s, of each
    motion: Double  # [n, F] mean over the interval
    times: Double  # [m] s, of commands
    commands: Double  # [m, F] held until the next
    max_age: float  # s, for which a command holds

    @classmethod
    def of(cls, signals: RobotSignals, log_map: LogMap) -> "_Fit | None":
        """Reads the signals of a robot; None if commands or motion never change."""
        command = signals.robot.command
        if signals.commands is None or len(signals.commands.times) < 2:
            return None
        origin, length = int(signals.positions.times[0]), log_map.dt / 2
        grid = np.arange(origin, int(signals.positions.times[-1]), nanoseconds(length))
        measured, known = _motion(signals, grid, nanoseconds(log_map.max_gap), length)
        columns = [k for k, each in enumerate(command.components) if each.commands in measured]
        named = [str(command.components[k].commands) for k in columns]
        motion = np.stack([measured[name] for name in named], axis=1)[known]
        values = signals.commands.values[:, columns]
        if not len(motion):
            return None
        moving = (np.ptp(values, axis=0) > 0) & (np.ptp(motion, axis=0) > 0)
        if not moving.any():
            return None
        return cls(
            starts=(grid[:-1][known] - origin) / NANOSECONDS,
            length=length,
            motion=motion[:, moving],
            times=(signals.commands.times - origin) / NANOSECONDS,
            commands=values[:, moving],
            max_age=command.max_gap or log_map.max_gap,
        )

    def score(self, offset: float) -> float:
        """Squared correlation of the shifted commands with the motion, from 0 to 1."""
        predicted, known = self._predict(offset)
        if known.sum() < max(8, LEAST_OVERLAP * len(self.starts)):
            return 0.0
        expected = predicted[known] - predicted[known].mean(axis=0)
        measured = self.motion[known] - self.motion[known].mean(axis=0)
        norms = np.sqrt((expected**2).sum(axis=0) * (measured**2).sum(axis=0))
        products = (expected * measured).sum(axis=0)
        correlations = np.divide(products, norms, out=np.zeros_like(norms), where=norms > 1e-12)
        return float((correlations.clip(0.0) ** 2).mean())

    def refine(self, offset: float, dt: float) -> float:
        """The offset of the greatest score near another one."""
        fine = dt / 16
        offsets = offset + fine * np.arange(-16, 17)
        scores = np.array([self.score(each) for each in offsets])
        k = int(np.argmax(scores[1:-1])) + 1
        before, here, after = scores[k - 1 : k + 2]
        bend = before - 2 * here + after
        shift = 0.5 * (before - after) / bend if bend < 0 else 0.0
        return float(offsets[k] + fine * np.clip(shift, -1, 1))

    def parts(self, offset: float) -> list["_Fit"]:
        """Parts of the log in which commands are known and change."""
        pieces = np.array_split(np.arange(len(self.starts)), N_PARTS)
        parts = [replace(self, starts=self.starts[k], motion=self.motion[k]) for k in pieces]
        return [part for part in parts if part.score(offset) > 0]

    def _predict(self, offset: float) -> tuple[Double, Bool]:
        """The mean command of each interval, [n, F], and where it is known, [n]."""
        first, last = self.starts - offset, self.starts + self.length - offset
        gaps = np.diff(self.times)[:, None]
        integral = np.cumsum(self.commands[:-1] * gaps, axis=0)
        integral = np.concatenate([np.zeros_like(self.commands[:1]), integral])
        ends = (
            np.interp(last, self.times, column) - np.interp(first, self.times, column)
            for column in integral.T
        )
        means = np.stack(list(ends), axis=1)
        newest = np.searchsorted(self.times, last, side="right") - 1
        known = (first >= self.times[0]) & (last <= self.times[-1])
        known &= last - self.times[newest.clip(0)] <= self.max_age
        return means / self.length, known


def _motion(
    signals: RobotSignals, grid: Int, gap: int, length: float
) -> tuple[dict[str, Double], Bool]:
    """Mean motion from each time of a grid to the next, [n] each by its name, and where known."""
    places, placed = interpolate(signals.positions, grid, gap)
    turns, _ = interpolate(signals.headings, grid, gap, is_angle=True)
    moved, turned = np.diff(places, axis=0) / length, wrap(np.diff(turns, axis=0))[:, 0]
    middle = turns[:-1, 0] + turned / 2
    found = planar_motion(moved, turned / length, middle, signals.robot.command.frame)
    return found, placed[:-1] & placed[1:]
