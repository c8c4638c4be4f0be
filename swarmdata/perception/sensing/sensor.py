"""Sensor: the observations of the robots of a task, by the model that the spec names."""

from collections.abc import Sequence

import numpy as np

from swarmdata.interfaces import Task
from swarmdata.perception.sensing.bearing import bearing_sense
from swarmdata.perception.sensing.lidar import lidar_sense
from swarmdata.perception.sensing.measured_world import MeasuredWorld, Sense, World
from swarmdata.perception.sensing.modifiers import Echoes, History
from swarmdata.perception.sensing.occupancy import occupancy_sense
from swarmdata.perception.sensing.sensed_scene import Scene
from swarmdata.perception.sensing.state import HEADING_FEATURES, PLACE_FEATURES, state_sense
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.features import Feature, shown_for, stacked
from swarmdata.specs.sensing_models import (
    BearingModel,
    LidarModel,
    ObservationModel,
    OccupancyModel,
    StateModel,
)
from swarmdata.specs.state_layout import N_COLUMNS, UX, UY
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Bool, Float, Int, Step


class Sensor:
    """Writes observations: a function of an episode's seed, layout and states up to the step.

    A frame holds the features of the model's kind and those of the task, computed from the world as
    each robot measured it. Noise and losses of beams and cells, hiding of the goal, leaving out of
    velocities, delay and stacking follow; in teams with several roles the robot's role is last.

    Attributes:
        features: of one robot's observation, O. In a stack the names of older frames end with
            their age in steps, such as `own.x[-1]`.
    """

    def __init__(self, task: Task, n_copies: int) -> None:
        spec, scene = task.spec, Scene.of(task)
        model = spec.observation
        self._task, self._sense = task, _sense(model, scene)
        self._robots = range(spec.n_agents)
        kind, extra = self._sense.features, task.features
        frame = (*kind, *extra)
        self._n_sensed, self._size = len(kind), len(frame)
        self._goal_steps = model.goal_steps
        self._goal_columns = np.flatnonzero([feature.tells_goal for feature in frame])
        if model.goal_steps is not None:
            frame = tuple(shown_for(model.goal_steps, feature) for feature in frame)
        self._pairs = _turned_pairs(model, kind, extra)
        self._heading = _heading_columns(model, kind)
        measured = MeasuredWorld(task, scene, n_copies)
        self._measured = None if measured.is_exact else measured
        self._added = np.zeros((n_copies, spec.n_agents, len(extra)), dtype=np.float32)
        echoes = Echoes(kind, self._sense.echoes, model, spec.randomization.noise)
        self._echoes = echoes if echoes.are_degraded else None
        kept = [k for k, feature in enumerate(frame) if _is_kept(feature, model)]
        frame = tuple(frame[k] for k in kept)
        self._kept = None if len(kept) == self._size else np.array(kept, dtype=np.int64)
        shape = (n_copies, spec.n_agents, len(kept))
        has_history = model.delay + model.stack > 1
        self._history = History(shape, model.delay, model.stack) if has_history else None
        self._frame = np.zeros(shape if has_history else (0, 0, 0), dtype=np.float32)
        whole = (*shape[:2], 0 if self._kept is None else self._size)
        self._whole = np.zeros(whole, dtype=np.float32)
        robots = (n_copies, spec.n_agents, N_COLUMNS)
        self._known = History(robots, model.delay) if model.delay > 0 else None
        self._late = np.zeros(robots if model.delay > 0 else (0, 0, 0), dtype=np.float32)
        self._roles = _role_codes(spec)
        roles = (role.name for role in spec.team[: self._roles.shape[1]])
        self.features = (*stacked(frame, model.stack), *map(_role_feature, roles))

    def forget(self, copies: Int) -> None:
        """Makes the next frame of each of these copies the first of an episode."""
        for memory in (self._measured, self._history, self._known):
            if memory is not None:
                memory.forget(copies)

    def observe(self, step: Step, active: Bool, out: Float) -> Float:
        """Writes the observations of the robots of the active copies.

        Args:
            step: the current step; its states, layouts, seeds and times are complete.
            active: copies to observe, [E]; rows of the others are not written.
            out: written, [E, N, O].

        Returns:
            The robots' measurements of themselves, columns `ROBOT` first, [E, >= 8 N], with the
            noise and delay of their sensors: what they can tell others. The next call overwrites
            them.
        """
        n_roles = self._roles.shape[1]
        frames = out[..., :-n_roles] if n_roles else out
        frame = frames if self._history is None else self._frame
        known = self._write_kept(step, active, frame)
        if self._history is not None:
            self._history.exchange(frame, active, frames)
        if n_roles:
            np.copyto(out[..., -n_roles:], self._roles, where=active[:, None, None])
        if self._known is None:
            return known
        n_copies, n, width = self._late.shape
        robots = known[:, : n * width].reshape(n_copies, n, width)
        self._known.exchange(robots, active, self._late)
        return self._late.reshape(n_copies, n * width)

    def _write_kept(self, step: Step, active: Bool, frame: Float) -> Float:
        """Writes the frames of all robots; returns their own measured states, [E, >= 8 N]."""
        if self._kept is None:
            return self._write_degraded(step, active, frame)
        known = self._write_degraded(step, active, self._whole)
        np.copyto(frame, self._whole[..., self._kept], where=active[:, None, None])
        return known

    def _write_degraded(self, step: Step, active: Bool, frame: Float) -> Float:
        """Does so with all features: turned, with losses, and with the goal hidden."""
        known = self._write_frame(step, active, frame)
        if len(self._pairs):
            turn(known, self._pairs, active, frame)
        if self._heading is not None:
            np.copyto(frame[..., self._heading], (1.0, 0.0), where=active[:, None, None])
        if self._echoes is not None:
            self._echoes.degrade(step, active, frame[..., : self._n_sensed])
        if self._goal_steps is not None:
            hide_columns(step.times, self._goal_steps, self._goal_columns, active, frame)
        return known

    def _write_frame(self, step: Step, active: Bool, frame: Float) -> Float:
        """Does so with all features, as sensed."""
        has_added = self._n_sensed < self._size
        if self._measured is None:
            truth = World(step.states, step.layouts, step.states, step.layouts, step.states)
            self._sense.sense(truth, self._robots, active, frame)
            if has_added:
                added = frame[..., self._n_sensed :]
                self._task.write_features(step.states, step.layouts, active, added)
            return step.states
        known = self._measured.localise(step, active)
        for i in self._robots:
            world = self._measured.measured_by(i, step, active)
            self._sense.sense(world, self._robots[i : i + 1], active, frame)
            if has_added:  # the task writes all robots, for one robot's world
                self._task.write_features(world.states, world.layouts, active, self._added)
                added = frame[:, i, self._n_sensed :]
                np.copyto(added, self._added[:, i], where=active[:, None])
        return known


def _turned_pairs(
    model: ObservationModel, kind: Sequence[Feature], extra: Sequence[Feature]
) -> Int:
    """Columns of the x components that are sensed in the world's frame, and shown in the body's."""
    if not model.in_body_frame:
        return np.zeros(0, dtype=np.int64)
    first = 0 if isinstance(model, StateModel) else len(kind)  # the others sense in the body's
    frame = (*kind, *extra)
    pairs = [k for k in range(first, len(frame)) if frame[k].axis == "x"]
    return np.array(pairs, dtype=np.int64)


def _heading_columns(model: ObservationModel, kind: Sequence[Feature]) -> slice | None:
    """Columns of the own heading in the own frame, where it is exactly (1, 0); None without any."""
    if not model.in_body_frame or HEADING_FEATURES[0] not in kind:
        return None
    first = list(kind).index(HEADING_FEATURES[0])
    return slice(first, first + 2)


def _is_kept(feature: Feature, model: ObservationModel) -> bool:
    if model.in_body_frame and feature in PLACE_FEATURES:
        return False
    return model.velocities or feature.kind != "velocity"


def _role_feature(role: str) -> Feature:
    return Feature(f"role.{role}", "flag", "", "1 if the robot has this role")


def _sense(model: ObservationModel, scene: Scene) -> Sense:
    match model:
        case StateModel():
            return state_sense(model, scene)
        case LidarModel():
            return lidar_sense(model, scene)
        case BearingModel():
            return bearing_sense(model, scene)
        case OccupancyModel():
            return occupancy_sense(model, scene)
    raise TypeError(f"no sensor for a {type(model).__name__}: add one to sensing.sensor")


def _role_codes(spec: TaskSpec) -> Float:
    """One-hot roles [N, roles]; no columns if there is only one role."""
    n_roles = len(spec.team)
    codes = np.eye(n_roles, n_roles if n_roles > 1 else 0, dtype=np.float32)
    return np.repeat(codes, [role.count for role in spec.team], axis=0)


@kernel
def hide_columns(times: Int, n_steps: int, columns: Int, active: Bool, frame: Float) -> None:
    """Sets columns [C] of a frame [E, N, F] to 0 from step `n_steps` of an episode on.

    Times are control steps since the reset, [E], of which the active copies, [E], change.
    """
    for b in range(frame.shape[0]):
        if not active[b] or times[b] < n_steps:
            continue
        for i in range(frame.shape[1]):
            for c in columns:
                frame[b, i, c] = 0.0


@kernel
def turn(states: Float, pairs: Int, active: Bool, frame: Float) -> None:
    """Rotates vectors from the world's frame into robots' frames, in place, in active copies [E].

    States are [E, S]; `pairs`, [P], are columns of x components in the frame [E, N, F], y follows.
    """
    for b in range(frame.shape[0]):
        if not active[b]:
            continue
        for i in range(frame.shape[1]):
            ux = float(states[b, N_COLUMNS * i + UX])
            uy = float(states[b, N_COLUMNS * i + UY])
            for p in range(pairs.shape[0]):
                x, y = float(frame[b, i, pairs[p]]), float(frame[b, i, pairs[p] + 1])
                frame[b, i, pairs[p]] = ux * x + uy * y
                frame[b, i, pairs[p] + 1] = ux * y - uy * x
