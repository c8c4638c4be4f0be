"""Cuts the grid of a log into episodes, and makes the episodes of robots' tracks.

An episode of T steps has T + 1 states, and no two episodes share a state. In the last state, which
was observed, the command is left out.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from swarmdata.interop.conversion.imported_data import build_episode, leaving
from swarmdata.interop.logs.resampling import Samples, hold
from swarmdata.interop.logs.robot_tracks import RobotTrack
from swarmdata.specs.origins.log_map import LogMap
from swarmdata.specs.spaces import stack_agents
from swarmdata.types import Bool, Episode, Float, Int


@dataclass(frozen=True, slots=True)
class Window:
    """The steps of one episode: the actions of times `start` to `stop - 1`, and how it ended."""

    start: int
    stop: int
    end: str  # `termination` or `truncation`

    def __len__(self) -> int:
        return self.stop - self.start


def acting_robots(tracks: Sequence[RobotTrack]) -> Bool:
    """Which robots act at each time: placed now and at the next time, and commanded, [K, N]."""
    placed = np.stack([each.is_placed for each in tracks], axis=1)
    commanded = np.stack([each.is_commanded for each in tracks], axis=1)
    acting = commanded & placed
    acting[:-1] &= placed[1:]
    acting[-1] = False
    return np.asarray(acting)


def find_windows(
    tracks: Sequence[RobotTrack], marker: Samples | None, grid: Int, log_map: LogMap
) -> tuple[list[Window], Counter[str]]:
    """Cuts a grid, [K] ns, as the map says; also counts the steps that are left out, by why."""
    acting = acting_robots(tracks)
    goes_on: Bool = np.asarray(acting.any(axis=1) if log_map.gaps == "mask" else acting.all(axis=1))
    broken = np.zeros(len(grid), np.bool_)  # the step to a new marker or goal is in no episode
    if marker is not None:
        values, is_marked = hold(marker, grid, None)
        goes_on &= is_marked
        broken[:-1] |= values[1:, 0] != values[:-1, 0]
    if (limit := log_map.episodes.goal_change) is not None:
        for each in tracks:
            moved = np.hypot(*np.diff(each.goals, axis=0).T)
            appeared = np.isnan(each.goals[:-1, 0]) & ~np.isnan(each.goals[1:, 0])
            broken[:-1] |= (moved > limit) | appeared  # NaN is not more than the limit
    edges = np.diff((goes_on & ~broken).astype(np.int8), prepend=0, append=0)
    starts, stops = np.flatnonzero(edges > 0), np.flatnonzero(edges < 0)
    found = []
    for start, stop in zip(starts.tolist(), stops.tolist(), strict=True):
        is_end = stop < len(grid) and bool(broken[stop]) and bool(goes_on[stop])
        found += _pieces(start, stop, log_map.episodes.ends if is_end else "truncation", log_map)
    kept = [each for each in found if len(each) >= log_map.episodes.min_steps]
    n_cut = sum(map(len, found))
    n_between = int(acting.any(axis=1).sum()) - n_cut
    n_short = n_cut - sum(map(len, kept))
    return kept, Counter(steps_between_episodes=n_between, steps_of_short_episodes=n_short)


def most_steps(log_map: LogMap) -> int | None:
    """Most steps of an episode, None without a limit."""
    length = log_map.episodes.length
    return None if length is None else max(1, round(length / log_map.dt))


def _pieces(start: int, stop: int, end: str, log_map: LogMap) -> list[Window]:
    """Cuts a run of steps at the greatest length; the step between two pieces is left out."""
    length = most_steps(log_map)
    if length is None:
        return [Window(start, stop, end)]
    starts = range(start, stop, length + 1)
    pieces = [Window(each, min(each + length, stop), "truncation") for each in starts]
    if pieces[-1].stop == stop:
        pieces[-1] = Window(pieces[-1].start, stop, end)
    return pieces


def with_reached_goals(tracks: Sequence[RobotTrack], windows: Sequence[Window]) -> list[RobotTrack]:
    """The tracks with new goals: where each robot is at the end of the episode."""
    goals = np.full((len(tracks), *tracks[0].goals.shape), np.nan)
    for window in windows:
        for k, each in enumerate(tracks):
            goals[k, window.start : window.stop + 1] = each.pose[window.stop, :2]
    return [replace(each, goals=goals[k]) for k, each in enumerate(tracks)]


def make_episodes(
    tracks: Sequence[RobotTrack],
    windows: Sequence[Window],
    states: Literal["observations", "poses"] = "observations",
) -> tuple[list[Episode], int]:
    """The episodes, and how many robot-steps are absent: none unless a robot has a gap."""
    everywhere = acting_robots(tracks)
    n_absent = sum(int((~everywhere[w.start : w.stop]).sum()) for w in windows)
    episodes = []
    for number, window in enumerate(windows):
        steps, places = slice(window.start, window.stop), slice(window.start, window.stop + 1)
        acting = everywhere[steps]
        seen = np.zeros((len(window) + 1, len(tracks)), np.bool_)
        seen[:-1] |= acting
        seen[1:] |= acting  # a robot also observes the state in which it stops acting
        observed = [each.observations[places] * seen[:, k, None] for k, each in enumerate(tracks)]
        shown = observed
        if states == "poses":
            poses = [each.pose[places].astype(np.float32) for each in tracks]
            shown = [pose * seen[:, k, None] for k, pose in enumerate(poses)]
        actions = [each.actions[steps] * acting[:, k, None] for k, each in enumerate(tracks)]
        rows: dict[str, Float | Bool] = {
            "observations": stack_agents(observed),
            "states": np.concatenate(shown, axis=1),
            "actions": stack_agents(actions),
            "rewards": np.stack([each.rewards[steps] for each in tracks], axis=1) * acting,
        }
        if n_absent:
            at_end = np.arange(len(window))[:, None] == len(window) - 1
            rows |= leaving(acting, acting & at_end & (window.end == "termination"))
        episodes.append(build_episode(rows, seed=number, policy=0, end=window.end))
    return episodes, n_absent
