"""RobotTrack, the signals of one robot at the times of the grid, and doubts about them."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from swarmdata.errors import ConversionError
from swarmdata.interop.logs.planar_frames import planar_motion
from swarmdata.interop.logs.resampling import (
    Samples,
    add_up,
    hold,
    interpolate,
    nanoseconds,
    wrap,
)
from swarmdata.interop.logs.robot_signals import RobotSignals
from swarmdata.specs.origins.log_map import CommandComponent, FeatureSignal, LogMap, Signal
from swarmdata.specs.origins.recorded_spec import RecordedAgent
from swarmdata.specs.spaces import BoxSpace, DictSpace, Space, common_bound
from swarmdata.types import Bool, Double, Float, Int

POSE_SPACE = BoxSpace(shape=(4,), dtype="float32")
"""x and y in the world (m), cosine and sine of the heading."""

POINT_SPACE = BoxSpace(shape=(2,), dtype="float32")

KNOWN_SPACE = BoxSpace(shape=(1,), dtype="float32", low=0.0, high=1.0)
"""1 where a signal is known; where it is not, its columns are 0, and so is this."""


MOST_RATIO = 3.0
"""Motion and command may differ by this factor: robots lag, slip, and have other scales."""

DRIVING_SHARE = 0.25
"""A robot drives where its command is at least this share of the largest one."""

LEAST_STEPS = 50  # of driving, to compare


@dataclass(frozen=True, slots=True, eq=False)
class RobotTrack:
    """One robot on a grid of K times."""

    agent: RecordedAgent
    observations: Float  # [K, O] 0 where a signal is unknown
    is_placed: Bool  # [K] whether its pose is known
    actions: Float  # [K, A] in force from each time on
    is_commanded: Bool  # [K] whether they are known
    rewards: Float  # [K] of the step from each time on
    goals: Double  # [K, 2] m; NaN where unknown
    pose: Double  # [K, 4] x, y (m), cosine and sine of the heading; 0 where unknown
    n_clipped: int  # commands outside their bounds


def with_bounds(signals: Sequence[RobotSignals]) -> list[RobotSignals]:
    """Gives components without bounds the least and greatest values that any robot logged."""
    logged: dict[str, list[Double]] = {}
    for each in signals:
        columns = () if each.commands is None else each.commands.values.T
        for component, column in zip(each.robot.command.components, columns, strict=False):
            logged.setdefault(component.column, []).append(column)

    def bounded(component: CommandComponent) -> CommandComponent:
        if component.low is not None:
            return component
        values = np.concatenate(logged[component.column])
        low, high = (float(values.min()), float(values.max())) if len(values) else (0.0, 0.0)
        if not low < high:
            raise ConversionError(
                f"the command {component.column} never changes in the logs, which gives no bounds; "
                "say its `low` and `high`"
            )
        return component.model_copy(update={"low": low, "high": high})

    found = []
    for each in signals:
        command = each.robot.command
        components = tuple(bounded(component) for component in command.components)
        command = command.model_copy(update={"components": components})
        found.append(replace(each, robot=each.robot.model_copy(update={"command": command})))
    return found


def make_track(signals: RobotSignals, log_map: LogMap, grid: Int) -> RobotTrack:
    """Resamples one robot; ConversionError for a command outside bounds that do not clip."""
    robot, K = signals.robot, len(grid)
    gap = _gap(robot.pose, log_map)
    positions, is_placed = interpolate(signals.positions, grid, gap)
    headings, _ = interpolate(signals.headings, grid, gap, is_angle=True)
    pose = np.concatenate([positions, np.cos(headings), np.sin(headings)], axis=1)
    pose *= is_placed[:, None]
    parts: dict[str, tuple[Space, Double]] = {}
    if log_map.states == "observations":
        parts["pose"] = (POSE_SPACE, pose)
    goals = np.full((K, 2), np.nan)
    if signals.goals is not None:
        held, known = hold(signals.goals, grid, None)
        goals[known] = held[known]
        parts |= _flagged("goal", POINT_SPACE, held, known)
    if robot.scan is not None and signals.scans is not None:
        n_beams = signals.scans.values.shape[1]
        farthest = float(np.float32(robot.scan.range_max))
        space = BoxSpace(shape=(n_beams,), dtype="float32", low=0.0, high=farthest)
        parts |= _flagged("scan", space, *hold(signals.scans, grid, _gap(robot.scan, log_map)))
    for feature, samples in zip(robot.features, signals.features, strict=True):
        values, known = _feature(feature, samples, grid, _gap(feature, log_map))
        space = BoxSpace(shape=(values.shape[1],), dtype="float32")
        parts |= _flagged(feature.name, space, values, known)
    commands, is_commanded = _commands(signals, log_map, grid, positions, headings, is_placed)
    actions, n_clipped = _bounded(signals, commands, is_commanded, grid)
    return RobotTrack(
        agent=_agent(signals, {name: space for name, (space, _) in parts.items()}),
        # the entries of a dictionary stand in the order of its sorted keys
        observations=np.concatenate(
            [values.astype(np.float32) for _, (_, values) in sorted(parts.items())], axis=1
        ),
        is_placed=is_placed,
        actions=actions,
        is_commanded=is_commanded,
        rewards=_rewards(signals, grid),
        goals=goals,
        pose=pose,
        n_clipped=n_clipped,
    )


def _gap(signal: Signal, log_map: LogMap) -> int:
    return nanoseconds(signal.max_gap or log_map.max_gap)


def _flagged(
    name: str, space: Space, values: Double, known: Bool
) -> dict[str, tuple[Space, Double]]:
    """A signal whose parts may be unknown, [K, S] or [K], and the columns that say where."""
    flags = known.reshape(len(known), -1).astype(np.float64)
    n_slots = flags.shape[1]
    whole = np.repeat(flags, values.shape[1] // n_slots, axis=1)
    flag_space = KNOWN_SPACE.model_copy(update={"shape": (n_slots,)})
    return {name: (space, values * whole), f"{name}_known": (flag_space, flags)}


def _feature(
    feature: FeatureSignal, slots: Sequence[Samples], grid: Int, gap: int
) -> tuple[Double, Bool]:
    """The columns of all slots of a feature, side by side, and which slots are known, [K, S]."""
    is_angle = feature.between == "angle"
    resample = hold if feature.between == "held" else partial(interpolate, is_angle=is_angle)
    found = [resample(each, grid, gap) for each in slots]
    values = [each for each, _ in found]
    if is_angle:
        values = [np.concatenate([np.cos(each), np.sin(each)], axis=1) for each in values]
    return np.concatenate(values, axis=1), np.stack([known for _, known in found], axis=1)


def _commands(
    signals: RobotSignals, log_map: LogMap, grid: Int, positions: Double, headings: Double,
    is_placed: Bool,
) -> tuple[Double, Bool]:  # fmt: skip
    """Commands in force from each time on, in SI units, [K, A], and which are known, [K]."""
    command = signals.robot.command
    if signals.commands is not None:
        return hold(signals.commands, grid, _gap(command, log_map))
    moved = np.diff(positions, axis=0, append=positions[-1:]) / log_map.dt
    turned = wrap(np.diff(headings, axis=0, append=headings[-1:])) / log_map.dt
    found = planar_motion(moved, turned[:, 0], headings[:, 0], command.frame)
    known = is_placed & np.append(is_placed[1:], False)
    values = np.stack([found[each.column] for each in command.components], axis=1)
    return values * known[:, None], known


def _bounded(signals: RobotSignals, commands: Double, known: Bool, grid: Int) -> tuple[Float, int]:
    """Commands within their bounds, [K, A], and how many were not."""
    command = signals.robot.command
    lows = np.array([each.low for each in command.components], np.float32)
    highs = np.array([each.high for each in command.components], np.float32)
    actions = commands.astype(np.float32)
    outside = ((actions < lows) | (actions > highs)) & known[:, None]
    if outside.any() and command.outside == "refuse":
        time, column = np.argwhere(outside)[0].tolist()
        each = command.components[column]
        raise ConversionError(
            f"the command {each.column} of {signals.robot.name} is {commands[time, column]:g} at "
            f"{(grid[time] - grid[0]) / 1e9:g} s, expected {each.low:g} to {each.high:g} (one of "
            f"{int(outside.any(axis=1).sum()):,} commands outside their bounds). Widen the bounds, "
            "or say `outside: clip`."
        )
    actions = np.where(known[:, None], actions.clip(lows, highs), np.float32(0))
    return actions, int(outside.any(axis=1).sum())


def _rewards(signals: RobotSignals, grid: Int) -> Float:
    """Rewards of the step from each time on, 0 where none were logged, [K]."""
    rewards = np.zeros(len(grid))
    if signals.rewards is not None and signals.robot.reward is not None:
        if signals.robot.reward.over == "sum":
            rewards[:-1] = add_up(signals.rewards, grid)[:, 0]
        else:
            rewards[:] = hold(signals.rewards, grid, None)[0][:, 0]
    return rewards.astype(np.float32)


def _agent(signals: RobotSignals, spaces: dict[str, Space]) -> RecordedAgent:
    components = signals.robot.command.components
    low = common_bound(np.array([each.low for each in components], np.float32))
    high = common_bound(np.array([each.high for each in components], np.float32))
    action = BoxSpace(shape=(len(components),), dtype="float32", low=low, high=high)
    seen = DictSpace(spaces=spaces)
    return RecordedAgent(name=signals.robot.name, observation=seen, action=action)


def span_of(tracks: list[RobotSignals]) -> tuple[int, int]:
    """First and last time at which a pose of any robot was logged, ns; each robot has some."""
    for each in tracks:
        if not len(each.positions.times):
            raise ConversionError(
                f"{each.robot.name} has no poses, expected at least two; a row without x, y or a "
                "heading is none, as one whose quaternion is zero"
            )
    first = min(int(each.positions.times[0]) for each in tracks)
    return first, max(int(each.positions.times[-1]) for each in tracks)


def doubts(
    signals: Sequence[RobotSignals], tracks: Sequence[RobotTrack], dt: float
) -> Iterator[str]:
    """Yields a sentence for each command that its robot's poses do not follow, and for absences.

    Compared are the median motion of a step, from poses, and the command of that motion, over the
    steps in which the robot drives.
    """
    for each, track in zip(signals, tracks, strict=True):
        yield from _unfollowed(each, track, dt)
    present = np.array([track.is_placed & track.is_commanded for track in tracks])
    for track, steps in zip(tracks, present, strict=True):
        if not steps.any():
            yield (
                f"{track.agent.name} is never there: at no time are its pose and its command both "
                "known; check its columns, its clock (`clock_offset`) and `max_gap`"
            )
    if len(tracks) > 1 and present.any(axis=1).all() and not present.all(axis=0).any():
        names = ", ".join(track.agent.name for track in tracks)
        yield f"at no time are {names} all there; check their clocks (`clock_offset`)"


def _unfollowed(signals: RobotSignals, track: RobotTrack, dt: float) -> Iterator[str]:
    """The commands of one robot that its motion contradicts."""
    command, pose = signals.robot.command, track.pose
    headings = np.arctan2(pose[:, 3], pose[:, 2])
    turned = wrap(np.diff(headings)[:, None])[:, 0]
    moved, middle = np.diff(pose[:, :2], axis=0) / dt, headings[:-1] + turned / 2
    motions = planar_motion(moved, turned / dt, middle, command.frame)
    is_known = track.is_placed[:-1] & track.is_placed[1:] & track.is_commanded[:-1]
    for column, component in enumerate(command.components):
        motion = motions.get(str(component.commands))
        if motion is None or command.differences:
            continue
        given, found = track.actions[:-1][is_known, column].astype(np.float64), motion[is_known]
        drives = np.abs(given) >= DRIVING_SHARE * np.abs(given).max(initial=0.0)
        drives &= given != 0
        if np.count_nonzero(drives) < LEAST_STEPS:
            continue
        ratio = float(np.median(found[drives] / given[drives]))
        if not 1 / MOST_RATIO <= ratio <= MOST_RATIO:
            yield (
                f"{track.agent.name} moves at {ratio:.2g} times its command {component.column}; "
                "check the units and frames of its poses and commands"
            )
