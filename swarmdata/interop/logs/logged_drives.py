"""Drives: where logged robots drove under which commands, and how a unicycle would have answered.

The answer is that of the simulators (`envs.physics.dynamics`). Commands c take effect
`delay` steps late and the motors follow with a lag of first order,

    u <- u + (1 - exp(-dt / lag)) (c - u)

and the robot drives with `speed_gain` u_v and turns with `turn_gain` u_omega. A speed acts from the
second of two physics steps on, a turn at once.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import ConversionError
from swarmdata.interop.logs.resampling import wrap
from swarmdata.specs.origins import RecordedSpec
from swarmdata.specs.origins.log_origin import ImportedLogs
from swarmdata.specs.spaces import DictSpace, Space, bounds, width
from swarmdata.types import Bool, Double, Int

LEAD = 1.0  # s
"""What of a drive only sets the motors going, whose command was not known before."""


@dataclass(frozen=True, slots=True)
class Response:
    """How a robot answers its commands."""

    speed_gain: float  # measured speed for one m/s
    turn_gain: float  # measured turn rate for one rad/s
    lag: float = 0.0  # s
    delay: int = 0  # steps


AS_COMMANDED = Response(speed_gain=1.0, turn_gain=1.0)  # of a robot that does what it is told
STANDING = Response(speed_gain=0.0, turn_gain=0.0)  # of a robot that does not move


@dataclass(frozen=True, eq=False)
class Drives:
    """What N robots did in E episodes of at most T steps."""

    names: tuple[str, ...]  # [N] of the robots
    dt: float  # s, duration of a step
    largest: tuple[float, float]  # m/s and rad/s, bounds of the commands
    poses: Double  # [E, N, T+1, 3] x, y (m) and heading (rad)
    commands: Double  # [E, N, T, 2] m/s, rad/s
    known: Bool  # [E, N, T] whether a step has its command and the poses around it

    @classmethod
    def of(cls, dataset: Dataset) -> "Drives":
        """Poses and commands of all episodes; ConversionError without logged v and omega."""
        origin = dataset.recipe
        if not isinstance(origin, ImportedLogs):
            raise ConversionError(
                f"{origin.id} has no commands that logged robots followed, expected a dataset that "
                "`swarmdata import` or `fetch` made of logs"
            )
        columns = _columns(origin)
        if not len(dataset):
            raise ConversionError(f"{origin.id} has no episode in this split")
        episodes = [dataset[k] for k in range(len(dataset))]
        N, T = dataset.spec.n_agents, max(len(each.actions) for each in episodes)
        poses = np.zeros((len(episodes), N, T + 1, 3))
        commands = np.zeros((len(episodes), N, T, 2))
        known = np.zeros((len(episodes), N, T), np.bool_)
        for k, episode in enumerate(episodes):
            t = len(episode.actions)
            for n, of in enumerate(columns):
                rows = episode.states if of.agent is None else episode.observations[:, of.agent]
                rows = rows[:, of.pose : of.pose + 4].astype(np.float64)
                poses[k, n, : t + 1, :2] = rows[:, :2]
                poses[k, n, : t + 1, 2] = np.arctan2(rows[:, 3], rows[:, 2])
                commands[k, n, :t] = episode.actions[:, n, of.actions]
            known[k, :, :t] = True if episode.alive is None else episode.alive[:-1].T
        speed, turn = np.max([each.largest for each in columns], axis=0).tolist()
        names, dt = dataset.spec.agent_names, origin.log_map.dt
        return cls(names, dt, (speed, turn), poses, commands, known)

    def part(self, episodes: slice = slice(None), robots: Sequence[int] | None = None) -> "Drives":
        """Some episodes of some robots; None: of all."""
        chosen = range(len(self.names)) if robots is None else robots
        return replace(
            self,
            names=tuple(self.names[n] for n in chosen),
            poses=self.poses[episodes][:, chosen],
            commands=self.commands[episodes][:, chosen],
            known=self.known[episodes][:, chosen],
        )

    def steps(self, seconds: float) -> int:
        """The number of steps that is nearest to a duration, at least one."""
        return max(1, round(seconds / self.dt))

    @cached_property
    def turns(self) -> Double:
        """Measured turn in each step, rad, [E, N, T]."""
        return wrap(np.diff(self.poses[..., 2], axis=-1))

    @cached_property
    def _directions(self) -> tuple[Double, Double]:
        """Measured directions in the two halves of each step, [E, N, T, 2] each."""
        headings = self.poses[..., :-1, 2]
        return _direction(headings), _direction(headings + self.turns / 2)

    def measured(self) -> Double:
        """Measured displacement (m) and turn (rad) in each step, [E, N, T, 3]."""
        moves = np.diff(self.poses[..., :2], axis=-2)
        return np.concatenate([moves, self.turns[..., None]], axis=-1)

    def motors(self, lag: float) -> Double:
        """Commands as motors follow them, without a delay and anew after each gap, [E, N, T, 2]."""
        share = 1.0 - np.exp(-self.dt / lag) if lag > 0 else 1.0
        followed = np.empty_like(self.commands)
        motor = self.commands[:, :, 0]
        goes_on = np.zeros_like(self.known[:, :, 0])
        for t in range(self.commands.shape[2]):
            given = self.commands[:, :, t]
            motor = np.where(goes_on[..., None], motor + share * (given - motor), given)
            followed[:, :, t] = motor
            goes_on = self.known[:, :, t]
        return followed

    def unit_motion(self, motors: Double, delay: int) -> Double:
        """Displacement and turn of steps at gains of 1, along measured headings, [E, N, T, 3]."""
        speeds = delayed(motors, delay)
        before = delayed(speeds, 1)
        first, second = self._directions
        moves = 0.5 * self.dt * (before[..., :1] * first + speeds[..., :1] * second)
        return np.concatenate([moves, self.dt * speeds[..., 1:]], axis=-1)

    def starts(self, length: int) -> Bool:
        """From which steps, after `LEAD`, a prediction of `length` steps can begin, [E, N, S]."""
        lead = self.steps(LEAD)
        n_starts = self.known.shape[2] - length + 1
        found = np.zeros((*self.known.shape[:2], max(n_starts, 0)), np.bool_)
        if n_starts > lead:
            whole = window_sums(self.known.astype(np.float64), lead + length)
            found[..., lead:] = whole > lead + length - 0.5
        return found

    def errors_of(self, responses: Sequence[Response], length: int) -> tuple[Double, Double, Int]:
        """Errors of open-loop predictions of so many steps, by each robot's response.

        A prediction begins in a measured pose and knows nothing later but commands; none overlap.
        Returns distances (m) and angles (rad) to the measured pose, and the episode of each, [n].
        """
        distances, angles, places = [], [], []
        starts = self.starts(length)
        for robot, response in enumerate(responses):
            alone = self.part(robots=[robot])
            episodes, times = _apart(starts[:, robot], length)
            end = alone._predict(response, episodes, times, length)
            true = alone.poses[episodes, 0, times + length]
            distances.append(np.hypot(*(end - true)[:, :2].T))
            angles.append(np.abs(wrap(end[:, 2] - true[:, 2])))
            places.append(episodes)
        return np.concatenate(distances), np.concatenate(angles), np.concatenate(places)

    def _predict(self, response: Response, episodes: Int, times: Int, length: int) -> Double:
        """Poses of the only robot, so many steps after those at some times, [n, 3]."""
        speeds = delayed(self.motors(response.lag), response.delay)[:, 0]
        speeds = speeds * np.array([response.speed_gain, response.turn_gain])
        before = np.concatenate([speeds[:, :1], speeds[:, :-1]], axis=1)
        pose = self.poses[episodes, 0, times].copy()
        for k in range(length):
            half = 0.5 * self.dt * speeds[episodes, times + k]
            pose[:, :2] += 0.5 * self.dt * before[episodes, times + k, :1] * _direction(pose[:, 2])
            pose[:, 2] += half[:, 1]
            pose[:, :2] += half[:, :1] * _direction(pose[:, 2])
            pose[:, 2] += half[:, 1]
        return pose


def _direction(headings: Double) -> Double:
    """Unit vectors, [..., 2]."""
    return np.stack([np.cos(headings), np.sin(headings)], axis=-1)


def delayed(rows: Double, delay: int) -> Double:
    """Rows [E, N, T, ...], so many steps later; the first one holds before."""
    if delay == 0:
        return rows
    first = np.repeat(rows[:, :, :1], min(delay, rows.shape[2]), axis=2)
    return np.concatenate([first, rows[:, :, :-delay]], axis=2)


def window_sums(rows: Double, length: int) -> Double:
    """Sums over so many steps from each one on, of rows [E, N, T, ...]: [E, N, T - length + 1]."""
    total = np.cumsum(rows, axis=2)
    total = np.concatenate([np.zeros_like(total[:, :, :1]), total], axis=2)
    return total[:, :, length:] - total[:, :, :-length]


def _apart(starts: Bool, length: int) -> tuple[Int, Int]:
    """Episodes and times of starts [E, S], of which two in an episode are `length` apart."""
    chosen: list[tuple[int, int]] = []
    for episode, times in enumerate(starts):
        free = 0
        for t in np.flatnonzero(times).tolist():
            if t >= free:
                chosen.append((episode, t))
                free = t + length
    found = np.array(chosen, np.int64).reshape(-1, 2)
    return found[:, 0], found[:, 1]


class _Columns(NamedTuple):
    """Where a robot's rows have its pose and commands."""

    agent: int | None  # whose observations have its pose; None: states have it
    pose: int  # the first column
    actions: list[int]  # speed and turn rate
    largest: Double  # m/s and rad/s, by their bounds


def _columns(origin: ImportedLogs) -> list[_Columns]:
    """Those of each robot."""
    what = f"{origin.id} has no commands that logged robots followed: "
    if not isinstance(origin.spec, RecordedSpec):
        raise ConversionError(
            f"{what}its observations are those of a task. Import the logs without --task"
        )
    found = []
    is_state = origin.spec.state_from == "poses"
    for n, (agent, robot) in enumerate(zip(origin.spec.agents, origin.log_map.robots, strict=True)):
        motions = [each.commands for each in robot.command.components]
        if robot.command.differences:
            raise ConversionError(f"{what}actions of {robot.name} are differences of its poses")
        if not {"v", "omega"} <= {*motions} or robot.command.frame != "body":
            raise ConversionError(
                f"{what}those of {robot.name} are {', '.join(map(str, motions))}, expected v and "
                "omega in its own frame; say `motion` of columns with other names"
            )
        actions = [motions.index("v"), motions.index("omega")]
        low, high = bounds(agent.action)
        largest = np.maximum(np.abs(low), np.abs(high))[actions]
        pose = 4 * n if is_state else _offset_of(agent.observation, "pose")
        found.append(_Columns(None if is_state else n, pose, actions, largest))
    return found


def _offset_of(space: Space, name: str) -> int:
    """The first column of an entry of a dictionary, whose entries stand in sorted order."""
    if not isinstance(space, DictSpace):
        raise TypeError(f"observations of logs are {space}, expected a dictionary")
    return sum(width(each) for key, each in space.spaces.items() if key < name)
