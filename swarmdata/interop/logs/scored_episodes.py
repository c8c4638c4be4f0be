"""Episodes of a task from logs: observed, rewarded and ended by the task's own functions.

What the logs and the map do not say of poses, goals and obstacles is refused, not guessed. The
first pose of an episode only gives the velocity of the second, as the difference. Robots go where
they were logged, and contacts are found from positions after every physics step.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from swarmdata.envs.physics.backend import Contacts, Moving
from swarmdata.envs.physics.contacts import update_contacts
from swarmdata.envs.world.task_env import TaskEnv
from swarmdata.errors import ConversionError, SpecError
from swarmdata.interfaces import Task
from swarmdata.interop.logs.episode_windows import Window, with_reached_goals
from swarmdata.interop.logs.resampling import interpolate, nanoseconds
from swarmdata.interop.logs.robot_signals import RobotSignals
from swarmdata.interop.logs.robot_tracks import RobotTrack
from swarmdata.numerics.geometry import BOX, CIRCLE
from swarmdata.registry.components import make_task
from swarmdata.specs.origins.log_map import LoggedRobot, LogMap, Motion
from swarmdata.specs.state_layout import TX, UY, X, robots_of
from swarmdata.specs.task_spec import Robot, TaskSpec
from swarmdata.types import (
    END_REASONS,
    STATE_FIELDS,
    STEP_FIELDS,
    Bool,
    Counts,
    Double,
    Episode,
    Float,
    Int,
    Seeds,
    Step,
)

COMMANDS: dict[str, tuple[Motion, Motion]] = {
    "unicycle": ("v", "omega"),
    "holonomic": ("vx", "vy"),
}
"""What the two numbers of an action command, by the dynamics of a robot."""

SHAPES = ("circle", "box", "corner", "pocket")  # names of the shape codes of `geometry`
SAME_GOAL = 1e-6  # greatest change of a goal (m) that is none: rounding in the log

LONGEST_ACTION = 1.0 + 1e-4
"""Greatest command, as a multiple of the robot's maximum, that is within it up to rounding."""


def check_task(spec: TaskSpec | None, log_map: LogMap) -> None:
    """Raises SpecError unless logs of a map have what the task needs, and need none without one."""
    if spec is None:
        if log_map.episodes.goals == "reached":
            raise SpecError("episodes.goals: reached is for a task that scores the logs, --task")
        return
    if problem := next(_problems(spec, log_map), None):
        raise SpecError(f"the logs cannot be scored by {spec.task}: {problem}")


def _problems(spec: TaskSpec, log_map: LogMap) -> Iterator[str]:
    if not hasattr(make_task(spec), "complete"):
        yield "its states hold more than robots and targets; leave out `--task`"
        return
    if len(log_map.robots) != spec.n_agents:
        yield (
            f"the map has {len(log_map.robots)} robots and the task {spec.n_agents}; their order "
            "is the same"
        )
    if abs(log_map.dt - spec.control_dt) > 1e-9:
        yield f"dt is {log_map.dt:g} s in the map and control_dt {spec.control_dt:g} s in the task"
    if log_map.gaps != "cut":
        yield "in a task no robot is ever absent, so the map has to say `gaps: cut`"
    if log_map.states != "observations":
        yield "its states are the task's own; leave out `states` of the map"
    if spec.action_size != 2:
        yield "its actions hold messages, which were not logged; choose another payload"
    for robot, kind in zip(log_map.robots, spec.robots, strict=False):
        yield from _robot_problems(robot, kind)
    missing = [robot.name for robot in log_map.robots if robot.goal is None]
    if missing and log_map.episodes.goals == "logged":
        yield (
            f"the map has no `goal` of {', '.join(missing)}; with `goals: reached` of `episodes`, "
            "they are where the robots went"
        )


def _robot_problems(robot: LoggedRobot, kind: Robot) -> Iterator[str]:
    unused = [name for name in ("scan", "features", "reward") if getattr(robot, name)]
    if unused:
        yield (
            f"the map has {', '.join(unused)} of {robot.name}, which the task computes itself; "
            "name their columns in `ignore`"
        )
    if kind.command != "velocity":
        yield "its robots take accelerations, which are no commands of logs; say command: velocity"
    wanted = COMMANDS[kind.dynamics]
    got = tuple(each.commands for each in robot.command.components)
    if got != wanted:
        yield (
            f"the commands of {robot.name} are {', '.join(map(str, got))}, expected "
            f"{', '.join(wanted)} for a {kind.dynamics} robot; say `motion` of the components"
        )
    frame = "body" if kind.dynamics == "unicycle" else "world"
    if robot.command.frame != frame:
        yield (
            f"the commands of {robot.name} are in the frame {robot.command.frame}, expected "
            f"{frame} for a {kind.dynamics} robot"
        )


def layout_of(spec: TaskSpec, log_map: LogMap) -> Float:
    """The obstacles, in the order of the task's shapes, [M, 8]; SpecError for other obstacles."""
    task = make_task(spec)
    rows = [
        (
            BOX if each.shape == "box" else CIRCLE, each.x, each.y, np.cos(each.heading),
            np.sin(each.heading), each.half_length, each.half_width or each.half_length, 0.0,
        )
        for each in log_map.obstacles
    ]  # fmt: skip
    if not spec.rules.demand(spec).is_drawn:
        if rows:
            raise SpecError("the task has its own obstacles; leave out `obstacles` of the map")
        layouts = np.zeros((1, len(task.kinds), 8), np.float32)
        states = np.zeros((1, 8 * spec.n_agents + len(task.extras)), np.float32)
        task.spawn(np.zeros(1, np.uint64), np.zeros(1, np.int64), layouts, states)
        return np.asarray(layouts[0])
    rows.sort(key=lambda row: -row[0])
    if [row[0] for row in rows] != sorted(task.kinds.tolist(), reverse=True):
        wanted = Counter(SHAPES[kind] for kind in task.kinds.tolist())
        listed = ", ".join(f"{n} {shape}" for shape, n in wanted.items()) or "none"
        got = Counter(each.shape for each in log_map.obstacles)
        raise SpecError(
            f"the task has obstacles: {listed}, and the map "
            f"{', '.join(f'{n} {shape}' for shape, n in got.items()) or 'none'}. `obstacles` of "
            "the map says where each of them stood (circles and boxes); the task's `obstacles` "
            "are their numbers."
        )
    return np.array(rows, np.float32).reshape(-1, 8)


class LoggedMotion(NamedTuple):
    """The motion of N robots in T steps, with P physics steps in each."""

    places: Double  # [T, P, N, 2] m, positions after each physics step
    robots: Double  # [T + 1, N, 6] x, y, vx, vy, ux, uy of each state
    goals: Double  # [T + 1, N, 2] m; NaN where unknown
    layout: Float  # [M, 8] obstacles, columns `geometry.OBSTACLE`

    def part(self, first: int, stop: int) -> "LoggedMotion":
        """The steps from `first` to `stop - 1`."""
        states = slice(first, stop + 1)
        places = self.places[first:stop]
        return LoggedMotion(places, self.robots[states], self.goals[states], self.layout)


def team_motion(
    spec: TaskSpec,
    log_map: LogMap,
    signals: Sequence[RobotSignals],
    tracks: Sequence[RobotTrack],
    grid: Int,
) -> LoggedMotion:
    """The motion at the times of the grid; of the first one no velocity is known."""
    P, step = spec.n_substeps, nanoseconds(log_map.dt)
    fine = (grid[:-1, None] + step * np.arange(1, P + 1) // P).reshape(-1)
    found, between, headings = [], [], []
    for each, track, robot in zip(signals, tracks, spec.robots, strict=True):
        gap = nanoseconds(each.robot.pose.max_gap or log_map.max_gap)
        found.append(interpolate(each.positions, grid, gap)[0])
        between.append(interpolate(each.positions, fine, gap)[0].reshape(-1, P, 2))
        is_unicycle = robot.dynamics == "unicycle"
        headings.append(
            track.pose[:, 2:] if is_unicycle else np.broadcast_to([1.0, 0.0], (len(grid), 2))
        )
    places = np.stack(found, axis=1)
    speeds = np.diff(places, axis=0, prepend=places[:1]) / log_map.dt
    return LoggedMotion(
        places=np.stack(between, axis=2),
        robots=np.concatenate([places, speeds, np.stack(headings, axis=1)], axis=2),
        goals=np.stack([track.goals for track in tracks], axis=1),
        layout=layout_of(spec, log_map),
    )


def _unit(track: RobotTrack, robot: Robot, logged: LoggedRobot) -> tuple[Float, int]:
    """Commands as multiples of a robot's maxima, [K, 2], and how many were greater than those."""
    second = robot.max_turn_rate if robot.dynamics == "unicycle" else robot.max_speed
    actions: Float = (track.actions / np.array([robot.max_speed, second])).astype(np.float32)
    greatest = np.abs(actions).max(axis=1, initial=0.0)
    outside: Bool = greatest > LONGEST_ACTION
    if outside.any() and logged.command.outside == "refuse":
        raise ConversionError(
            f"a command of {logged.name} is {greatest.max():.3g} times the maximum of the task's "
            "robot. Raise max_speed or max_turn_rate of the task, or say `outside: clip` in the "
            "map."
        )
    return actions.clip(-1.0, 1.0), int(outside.sum())


def score_episodes(
    spec: TaskSpec,
    log_map: LogMap,
    signals: Sequence[RobotSignals],
    tracks: Sequence[RobotTrack],
    grid: Int,
    windows: Sequence[Window],
) -> tuple[list[Episode], Counter[str]]:
    """Makes an episode of each window that is long enough; counts what was left out or clipped.

    Raises:
        SpecError: the map has other obstacles than the task.
        ConversionError: a goal is unknown or moves, or a robot is outside the arena.
    """
    if log_map.episodes.goals == "reached":
        tracks = with_reached_goals(tracks, windows)
    units = [_unit(t, r, s.robot) for t, r, s in zip(tracks, spec.robots, signals, strict=True)]
    actions = np.stack([commands for commands, _ in units], axis=1)
    motion = team_motion(spec, log_map, signals, tracks, grid)
    world, episodes = LoggedWorld(make_task(spec)), list[Episode]()
    counts = Counter({"commands_clipped_to_the_task": sum(n for _, n in units)})
    for window in windows:
        counts["first_poses"] += 1
        first, stop = window.start + 1, window.stop
        if stop - first < log_map.episodes.min_steps:
            counts["steps_of_short_episodes"] += stop - first
            continue
        world.motion = motion.part(first, stop)
        _check_motion(spec, log_map, world.motion)
        steps = [world.env.reset(np.array([len(episodes)], np.uint64))]
        for t in range(first, stop):
            steps.append(world.env.step(actions[t][None]))
            if steps[-1].ended[0]:
                break
        counts["steps_after_the_end"] += len(window) - len(steps)
        episodes.append(_episode(steps, actions[first : first + len(steps) - 1]))
    return episodes, counts


def _check_motion(spec: TaskSpec, log_map: LogMap, motion: LoggedMotion) -> None:
    goals, places = motion.goals, motion.robots[..., :2]
    bad: Bool = np.isnan(goals[..., 0]) | (np.abs(goals - goals[0]) > SAME_GOAL).any(axis=2)
    if bad.any():
        time, robot = np.argwhere(bad)[0].tolist()
        what = "is unknown" if np.isnan(goals[time, robot, 0]) else "moves within an episode"
        raise ConversionError(
            f"the goal of {log_map.robots[robot].name} {what}, {time * log_map.dt:g} s after the "
            "episode's start. Cut episodes there: `episodes.goal_change` or a marker."
        )
    half = np.array(spec.half_size)
    outside: Bool = np.any(np.abs(places) > half, axis=2)
    if outside.any():
        time, robot = np.argwhere(outside)[0].tolist()
        x, y = places[time, robot]
        raise ConversionError(
            f"{log_map.robots[robot].name} is at ({x:.2f}, {y:.2f}) m, outside the task's arena, "
            f"which is centred on the origin and {2 * half[0]:g} m by {2 * half[1]:g} m. Move the "
            "poses by `transforms` of the map, or enlarge the arena."
        )


def _episode(steps: Sequence[Step], actions: Float) -> Episode:
    """The episode of the steps of one copy; the log's end truncates it."""
    last, T = steps[-1], len(steps) - 1
    is_over = bool(last.terminations[0])
    at_end = np.arange(T) == T - 1
    reason = "success" if last.successes[0] else "failure" if is_over else "horizon"
    rows = {name: np.stack([getattr(s, name)[0] for s in steps]) for name in STATE_FIELDS}
    names = [name for name in STEP_FIELDS if hasattr(last, name)]
    of_steps = {name: np.stack([getattr(s, name)[0] for s in steps[1:]]) for name in names}
    flags = {"terminations": at_end & is_over, "truncations": at_end & (not is_over)}
    return Episode(
        **rows,
        **{**of_steps, **flags},
        actions=actions.copy(),
        log_probs=np.zeros((T, 0), np.float32),
        reward_terms=np.stack([step.reward_terms[0] for step in steps[1:]]),
        layout=last.layouts[0].copy(),
        seed=int(last.seeds[0]),
        policy=0,
        end_reason=END_REASONS.index(reason),
    )


class LoggedWorld:
    """One copy of a task whose own code, in `env`, observes and scores motion that is played back.

    To `env` it is both the task, whose episodes start where the robots were logged, and its
    `Backend`, in which positions are those of a motion, not of commands.
    """

    motion: LoggedMotion  # of the episode

    def __init__(self, task: Task) -> None:
        self._task, self._t = task, 0
        self._radii: Double = np.array([robot.radius for robot in task.spec.robots])
        self._half: Double = np.array(task.spec.half_size)
        self.env = TaskEnv(self, 1, backend=lambda plan, n_copies: self)  # type: ignore[arg-type]

    def __getattr__(self, name: str) -> Any:
        return getattr(self._task, name)

    def spawn(self, seeds: Seeds, copies: Int, layouts: Float, states: Float) -> None:
        robots = robots_of(states, self._task.spec.n_agents)
        layouts[0] = self.motion.layout
        robots[0, :, X : UY + 1] = self.motion.robots[0]
        robots[0, :, TX:] = self.motion.goals[0]
        self._task.complete(states, copies)  # type: ignore[attr-defined]  # `check_task` saw it

    def reset(self, copies: Int, layouts: Float, moving: Moving) -> None:
        self._layout, self._t = layouts[0].copy(), 0

    def step(
        self, active: Bool, commands: Double, contacts: Contacts, events: Counts, states: Float
    ) -> None:
        if not active[0]:
            return
        for places in self.motion.places[self._t]:
            update_contacts(
                np.ascontiguousarray(places), self._radii, self._layout, self._half,
                contacts.robots[0], contacts.obstacles[0], contacts.slack[0], events[0],
            )  # fmt: skip
        self._t += 1
        robots_of(states, len(self._radii))[0, :, X : UY + 1] = self.motion.robots[self._t]
