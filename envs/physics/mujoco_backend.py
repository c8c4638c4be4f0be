"""A second simulator: robots by the same commands as in Pymunk, contacts by MuJoCo.

`dynamics.drive` gives the force of each robot, and MuJoCo moves all bodies, in steps of at most
`mujoco_model.LONGEST_STEP`; in free motion, in one step and without looking for contacts. Events
are found from positions, by `contacts.update_contacts`, as in Pymunk. Repeated episodes have the
same bits on one machine, with one version of MuJoCo.
"""

import math
from typing import Annotated, Any, NamedTuple

import mujoco
import numpy as np

from swarmdata.envs.physics.backend import Contacts, Moving, Plan, write_state
from swarmdata.envs.physics.contacts import update_contacts
from swarmdata.envs.physics.dynamics import MASS, N_LIMITS, drive
from swarmdata.envs.physics.episode_bodies import N_PAYLOAD
from swarmdata.envs.physics.free_motion import is_free
from swarmdata.envs.physics.mujoco_model import WorldModel, steps_in
from swarmdata.envs.physics.mujoco_wheels import N_POSITIONS, N_VELOCITIES, wheel_speeds
from swarmdata.envs.physics.mujoco_wheels import read as read_wheeled
from swarmdata.envs.physics.mujoco_wheels import start as start_wheeled
from swarmdata.errors import SimulationError
from swarmdata.runtime.argument_blocks import ArgumentBlock, bundle_type, unpack
from swarmdata.runtime.kernels import kernel
from swarmdata.types import Bool, Counts, Double, Float, Int

NO_CONTACTS = int(mujoco.mjtDisableBit.mjDSBL_CONTACT)

NO_MIDPHASE = int(mujoco.mjtDisableBit.mjDSBL_MIDPHASE)
"""For so few shapes, a tree of boxes around those of one body costs more than testing them all."""


PLACE, SPEED, WHEELS = range(3)  # of the joints: first position and velocity, whether on wheels


class Coordinates(NamedTuple):
    """What kernels read and write of one copy: memory of MuJoCo."""

    forces: Annotated[Double, 1]  # [2 N] N, or rad/s of wheels
    positions: Annotated[Double, 1]  # [P] of all joints
    velocities: Annotated[Double, 1]  # [V] of all joints


COORDINATES = bundle_type(Coordinates)

N_WORDS = 2 * len(Coordinates._fields)  # of packed `Coordinates`: an address and a length for each


class _Copy(NamedTuple):
    model: Any  # mujoco.MjModel
    data: Any  # mujoco.MjData
    option: Any  # of the model
    coordinates: Coordinates
    warnings: Int  # how many of each kind; memory of MuJoCo
    limits: Double  # [N, 9] as written in the model
    payloads: Double  # [K, 4] as written in the model


class Worlds(NamedTuple):
    """What kernels read and write of E copies in every step."""

    limits: Annotated[Double, 3]  # [E, N, 9] of `limits_of`
    n_substeps: int  # physics steps in a control step
    dt: float  # s, of a physics step
    n_short: int  # MuJoCo's steps in one near contacts
    can_be_free: bool  # whether a physics step can be one step of MuJoCo
    radii: Annotated[Double, 1]  # [N] m
    half: Annotated[Double, 1]  # [2] half width and half height of the arena, m
    joints: Annotated[Int, 2]  # [N + K, 3] of `_joints`
    layouts: Annotated[Float, 3]  # [E, M, 8]
    robots: Annotated[Double, 3]  # [E, N, 6] columns as in `drive`
    bodies: Annotated[Double, 3]  # [E, K, 7] columns `state_layout.BODY`
    accelerations: Annotated[Double, 3]  # [E, N, 2] m/s^2
    coordinates: Annotated[Int, 2]  # [E, N_WORDS] packed `Coordinates` of each copy
    n_steps: Annotated[Int, 1]  # [E] MuJoCo's steps in this physics step, 0 in copies that ended
    is_free: Annotated[Bool, 1]  # [E] whether nothing can touch in this physics step


WORLDS = bundle_type(Worlds)


@kernel
def _push(packed: Int, k: int, active: Bool, commands: Double, slack: Double) -> None:
    """Writes what the motors do in physics step `k`, and how many steps of MuJoCo it takes."""
    ours = unpack(packed, WORLDS)
    travel = np.empty(ours.radii.shape[0])  # beyond that by the velocities
    for b in range(active.shape[0]):
        ours.n_steps[b] = ours.n_short if active[b] else 0
        if not active[b]:
            continue
        limits, accelerations = ours.limits[b], ours.accelerations[b]
        forces = unpack(ours.coordinates[b], COORDINATES).forces
        drive(ours.robots[b], commands[b], limits, ours.n_substeps, ours.dt, k, accelerations)
        for i in range(travel.shape[0]):
            ax, ay = accelerations[i, 0], accelerations[i, 1]
            travel[i] = math.sqrt(ax * ax + ay * ay) * ours.dt * ours.dt
            if not ours.joints[i, WHEELS]:
                forces[2 * i], forces[2 * i + 1] = limits[i, MASS] * ax, limits[i, MASS] * ay
        ours.is_free[b] = ours.can_be_free and is_free(
            ours.robots[b], ours.dt, travel, ours.radii, ours.layouts[b], ours.half, slack[b]
        )
        if ours.is_free[b]:
            ours.n_steps[b] = 1


@kernel
def _steer(packed: Int, s: int, commands: Double) -> None:
    ours = unpack(packed, WORLDS)
    for b in range(ours.n_steps.shape[0]):
        if ours.n_steps[b] <= s:
            continue
        forces = unpack(ours.coordinates[b], COORDINATES).forces
        for i in range(ours.radii.shape[0]):
            if ours.joints[i, WHEELS]:
                forces[2 * i], forces[2 * i + 1] = wheel_speeds(
                    ours.robots[b, i], commands[b, i], ours.limits[b, i], ours.radii[i]
                )


@kernel
def _read_bodies(
    positions: Double, velocities: Double, joints: Int, robots: Double, bodies: Double
) -> None:
    n = robots.shape[0]
    for i in range(n):
        place, speed = joints[i, PLACE], joints[i, SPEED]
        if joints[i, WHEELS]:
            read_wheeled(positions, velocities, place, speed, robots[i])
            continue
        for c in range(2):
            robots[i, c], robots[i, 2 + c] = positions[place + c], velocities[speed + c]
    for k in range(bodies.shape[0]):
        place, speed, row = joints[n + k, PLACE], joints[n + k, SPEED], bodies[k]
        for c in range(2):
            row[c], row[2 + c] = positions[place + c], velocities[speed + c]
        row[4], row[5] = math.cos(positions[place + 3]), math.sin(positions[place + 3])
        row[6] = velocities[speed + 3]


@kernel
def _read(packed: Int, s: int, touching: Bool, static: Bool, slack: Double, events: Counts) -> None:
    """Reads what moves after step `s` of MuJoCo, and finds contacts."""
    ours = unpack(packed, WORLDS)
    for b in range(ours.n_steps.shape[0]):
        if ours.n_steps[b] > s:
            _, positions, velocities = unpack(ours.coordinates[b], COORDINATES)
            _read_bodies(positions, velocities, ours.joints, ours.robots[b], ours.bodies[b])
            update_contacts(
                ours.robots[b], ours.radii, ours.layouts[b], ours.half, touching[b], static[b],
                slack[b], events[b],
            )  # fmt: skip


@kernel
def _write(packed: Int, active: Bool, states: Float) -> None:
    ours = unpack(packed, WORLDS)
    for b in range(active.shape[0]):
        if active[b]:
            write_state(ours.robots[b], ours.bodies[b], states[b])


class MujocoBackend:
    """Implements `Backend` with MuJoCo."""

    def __init__(self, plan: Plan, n_copies: int) -> None:
        spec, (n, k) = plan.spec, (plan.spec.n_agents, len(plan.movables))
        self._model = WorldModel(plan)
        joints = _joints(plan)
        self._has_wheels = bool(joints[:, WHEELS].any())
        self.worlds = Worlds(
            limits=np.zeros((n_copies, n, N_LIMITS)),
            n_substeps=spec.n_substeps,
            dt=spec.physics_dt,
            n_short=steps_in(spec.physics_dt),
            can_be_free=k == 0 and not self._has_wheels,
            radii=np.array([robot.radius for robot in spec.robots]),
            half=np.array(spec.half_size),
            joints=joints,
            layouts=np.zeros((n_copies, len(plan.kinds), 8), np.float32),
            robots=np.zeros((n_copies, n, 6)),
            bodies=np.zeros((n_copies, k, 7)),
            accelerations=np.zeros((n_copies, n, 2)),
            coordinates=np.zeros((n_copies, N_WORDS), np.int64),
            n_steps=np.zeros(n_copies, np.int64),
            is_free=np.zeros(n_copies, np.bool_),
        )
        self._block = ArgumentBlock(self.worlds, WORLDS)
        self._copies: list[_Copy | None] = [None] * n_copies
        self._is_open: Bool = np.zeros(n_copies, np.bool_)  # whether MuJoCo looks for no contacts

    def reset(self, copies: Int, layouts: Float, moving: Moving) -> None:
        ours = self.worlds
        ours.robots[copies], ours.bodies[copies] = moving.robots, moving.bodies
        ours.layouts[copies], ours.limits[copies] = layouts[copies], moving.limits
        loads = np.broadcast_to(moving.payloads, (len(copies), *moving.payloads.shape[-2:]))
        for b, load in zip(copies.tolist(), loads, strict=True):
            self._start(b, load)

    def _start(self, b: int, payloads: Double) -> None:
        ours, copy = self.worlds, self._copies[b] or self._new(b)
        self._model.write_obstacles(copy.model, ours.layouts[b])
        is_same = np.array_equal(copy.limits, ours.limits[b])
        if not (is_same and np.array_equal(copy.payloads, payloads)):
            copy.limits[:], copy.payloads[:] = ours.limits[b], payloads
            self._model.write_bodies(copy.model, copy.data, copy.limits, copy.payloads)
        mujoco.mj_resetData(copy.model, copy.data)
        rows, joints = (*ours.robots[b], *ours.bodies[b]), copy.coordinates
        for k, (row, (place, speed, on_wheels)) in enumerate(zip(rows, ours.joints, strict=True)):
            positions, velocities = joints.positions[place:], joints.velocities[speed:]
            if on_wheels:
                start_wheeled(row, positions, velocities)
                continue
            positions[:2], velocities[:2] = row[:2], row[2:4]
            if k >= ours.robots.shape[1]:
                positions[3], velocities[3] = np.arctan2(row[5], row[4]), row[6]

    def _new(self, b: int) -> _Copy:
        model, ours = self._model.new(), self.worlds
        data = mujoco.MjData(model)
        found = Coordinates(data.ctrl, data.qpos, data.qvel)
        ours.coordinates[b] = ArgumentBlock(found, COORDINATES).packed
        unwritten = (
            np.full((len(ours.radii), N_LIMITS), np.nan),
            np.full((ours.bodies.shape[1], N_PAYLOAD), np.nan),
        )
        copy = _Copy(model, data, model.opt, found, data.warning.number, *unwritten)
        copy.option.disableflags = NO_MIDPHASE
        self._copies[b] = copy
        return copy

    def step(
        self, active: Bool, commands: Double, contacts: Contacts, events: Counts, states: Float
    ) -> None:
        packed, ours = self._block.packed, self.worlds
        copies = [self._copy(b) for b in np.flatnonzero(active).tolist()]
        for k in range(ours.n_substeps):
            _push(packed, k, active, commands, contacts.slack)
            for b in np.flatnonzero(active & (ours.is_free != self._is_open)).tolist():
                self._switch(b)
            for s in range(ours.n_short):
                if self._has_wheels:
                    _steer(packed, s, commands)
                for b in np.flatnonzero(ours.n_steps > s).tolist():
                    copy = self._copy(b)
                    mujoco.mj_step(copy.model, copy.data)
                _read(packed, s, *contacts, events)
        _write(packed, active, states)
        _check_warnings(np.array([copy.warnings for copy in copies]))

    def _switch(self, b: int) -> None:
        """Makes MuJoCo look for contacts in copy `b`, or take one long step without."""
        ours, option = self.worlds, self._copy(b).option
        self._is_open[b] = ours.is_free[b]
        option.timestep = ours.dt / ours.n_steps[b]
        option.disableflags = NO_CONTACTS if ours.is_free[b] else NO_MIDPHASE

    def _copy(self, b: int) -> _Copy:
        copy = self._copies[b]
        if copy is None:
            raise RuntimeError(f"copy {b} was stepped before its first reset")
        return copy


def _joints(plan: Plan) -> Int:
    """Where the joints of robots and payloads are, [N + K, 3]."""
    rows, place, speed = [], 0, 0
    for robot in plan.spec.robots:
        on_wheels = robot.base == "wheels"
        rows.append((place, speed, on_wheels))
        place += N_POSITIONS if on_wheels else 2
        speed += N_VELOCITIES if on_wheels else 2
    rows += [(place + 4 * k, speed + 4 * k, False) for k in range(len(plan.movables))]
    return np.array(rows, dtype=np.int64)


def _check_warnings(numbers: Int) -> None:
    """Checks that MuJoCo had room for all contacts, and did not diverge; `numbers` [E, W]."""
    if numbers.any():
        kinds = [mujoco.mjtWarning(k).name for k in np.flatnonzero(numbers.any(0)).tolist()]
        raise SimulationError(
            f"MuJoCo {mujoco.__version__} warned in a world: {', '.join(kinds)}, expected no "
            "warning; its positions cannot be trusted. Use fewer robots or a shorter physics_dt, "
            "or backend pymunk."
        )
