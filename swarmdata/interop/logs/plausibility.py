"""What is implausible about imported robots: motions and commands, or clocks, that do not fit."""

from collections.abc import Iterator, Sequence

import numpy as np

from swarmdata.interop.logs.planar_frames import planar_motion
from swarmdata.interop.logs.resampling import wrap
from swarmdata.interop.logs.robot_signals import RobotSignals
from swarmdata.interop.logs.robot_tracks import RobotTrack

MOST_RATIO = 3.0
"""Motion and command may differ by this factor: robots lag, slip, and have other scales."""

DRIVING_SHARE = 0.25
"""A robot drives where its command is at least this share of the largest one."""

LEAST_STEPS = 50  # of driving, to compare


def doubts(
    signals: Sequence[RobotSignals], tracks: Sequence[RobotTrack], dt: float
) -> Iterator[str]:
    """Yields a sentence for each command that its robot's poses do not follow, and for clocks.

    Compared are the median motion of a step, from poses, and the command of that motion, over the
    steps in which the robot drives.
    """
    for each, track in zip(signals, tracks, strict=True):
        yield from _unfollowed(each, track, dt)
    present = np.array([track.is_placed & track.is_commanded for track in tracks])
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
