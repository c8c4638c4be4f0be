"""A second simulator: robots by the same commands as in Pymunk, contacts by MuJoCo.

In every physics step, `dynamics.drive` gives the force of each robot, as in the other backends,
and MuJoCo moves all bodies. It does so in steps of at most `mujoco_model.LONGEST_STEP`; in free
motion, as `free_motion` defines it, in one step and without looking for contacts. Events are found
from positions, by `contacts.update_contacts`, after every step, so a collision is defined by the
same distances as in Pymunk.

Repeated episodes have the same bits on one machine, with one version of MuJoCo. Other machines and
versions may give others.
"""

import math
from typing import Any, NamedTuple

import mujoco
import numpy as np

from swarmdata.envs.physics.backend import Contacts, Plan, write_state
from swarmdata.envs.physics.contacts import update_contacts
from swarmdata.envs.physics.dynamics import MASS, drive
from swarmdata.envs.physics.free_motion import is_free
from swarmdata.envs.physics.mujoco_model import WorldModel, steps_in
from swarmdata.envs.physics.mujoco_wheels import N_POSITIONS, N_VELOCITIES, wheel_speeds
from swarmdata.envs.physics.mujoco_wheels import read as read_wheeled
from swarmdata.envs.physics.mujoco_wheels import start as start_wheeled
from swarmdata.errors import SimulationError
from swarmdata.runtime.kernels import kernel
from swarmdata.types import Bool, Counts, Double, Float, Int

NO_CONTACTS = int(mujoco.mjtDisableBit.mjDSBL_CONTACT)

NO_MIDPHASE = int(mujoco.mjtDisableBit.mjDSBL_MIDPHASE)
"""A tree of boxes around the shapes of one body costs more than testing them all: steps take 10 to
35 % less time without it, for 11 to 64 shapes."""


PLACE, SPEED, WHEELS = range(3)
"""Columns of the joints: first position, first velocity, whether it is a robot on wheels."""


class _Copy(NamedTuple):
    """The world of one copy; the arrays are memory of MuJoCo."""

    model: Any  # mujoco.MjModel
    data: Any  # mujoco.MjData
    option: Any  # of the model
    forces: Double  # N, or rad/s of wheels, [2 N]
    positions: Double  # of all joints
    velocities: Double  # of all joints
    warnings: Int  # how many of each kind


@kernel
def _push(
    b: int, k: int, robots: Double, commands: Double, limits: Double, n_substeps: int, dt: float,
    accelerations: Double, forces: Double, can_be_free: bool, radii: Double, half: Double,
    layouts: Float, joints: Int, slack: Double,
) -> bool:  # fmt: skip
    """Writes what the motors do in physics step `k`; returns whether it is free."""
    drive(robots[b], commands[b], limits[b], n_substeps, dt, k, accelerations)
    for i in range(accelerations.shape[0]):
        if not joints[i, WHEELS]:
            for c in range(2):
                forces[2 * i + c] = limits[b, i, MASS] * accelerations[i, c]
    if not can_be_free:
        return False
    travel = np.empty(radii.shape[0])  # beyond that by the velocities
    for i in range(travel.shape[0]):
        ax, ay = accelerations[i, 0], accelerations[i, 1]
        travel[i] = math.sqrt(ax * ax + ay * ay) * dt * dt
    return is_free(robots[b], dt, travel, radii, layouts[b], half, slack[b])


@kernel
def _steer(
    b: int, robots: Double, commands: Double, limits: Double, radii: Double, joints: Int,
    forces: Double,
) -> None:  # fmt: skip
    """Writes the wheels' speeds in a step of MuJoCo."""
    for i in range(radii.shape[0]):
        if joints[i, WHEELS]:
            forces[2 * i], forces[2 * i + 1] = wheel_speeds(
                robots[b, i], commands[b, i], limits[b, i], radii[i]
            )


@kernel
def _read(
    b: int, positions: Double, velocities: Double, robots: Double, bodies: Double, radii: Double,
    half: Double, layouts: Float, joints: Int, touching: Bool, static: Bool, slack: Double,
    events: Counts,
) -> None:  # fmt: skip
    """Reads what moves in copy `b`, and finds its contacts."""
    n = robots.shape[1]
    for i in range(n):
        place, speed = joints[i, PLACE], joints[i, SPEED]
        if joints[i, WHEELS]:
            read_wheeled(positions, velocities, place, speed, robots[b, i])
            continue
        for c in range(2):
            robots[b, i, c], robots[b, i, 2 + c] = positions[place + c], velocities[speed + c]
    for k in range(bodies.shape[1]):
        place, speed, row = joints[n + k, PLACE], joints[n + k, SPEED], bodies[b, k]
        for c in range(2):
            row[c], row[2 + c] = positions[place + c], velocities[speed + c]
        row[4], row[5] = math.cos(positions[place + 3]), math.sin(positions[place + 3])
        row[6] = velocities[speed + 3]
    update_contacts(
        robots[b], radii, layouts[b], half, touching[b], static[b], slack[b], events[b]
    )  # fmt: skip


@kernel
def _write(b: int, robots: Double, bodies: Double, states: Float) -> None:
    write_state(robots[b], bodies[b], states[b])


class MujocoBackend:
    """Implements `Backend` with MuJoCo."""

    def __init__(self, plan: Plan, n_copies: int) -> None:
        spec = plan.spec
        n, k = spec.n_agents, len(plan.movables)
        self._world = WorldModel(plan)
        self._n_substeps, self._dt = spec.n_substeps, spec.physics_dt
        self._n_short = steps_in(self._dt)
        self._joints = _joints(plan)
        self._has_wheels = bool(self._joints[:, WHEELS].any())
        self._can_be_free = k == 0 and not self._has_wheels
        self._copies: list[_Copy | None] = [None] * n_copies
        self._layouts: Float = np.zeros((n_copies, len(plan.kinds), 8), np.float32)
        self._robots: Double = np.zeros((n_copies, n, 6))
        self._bodies: Double = np.zeros((n_copies, k, 7))
        self._limits: Double = np.zeros((n_copies, n, 8))
        self._radii = np.array([robot.radius for robot in spec.robots])
        self._half = np.array(spec.half_size)
        self._accelerations: Double = np.zeros((n, 2))

    def reset(
        self, copies: Int, layouts: Float, robots: Double, bodies: Double, limits: Double
    ) -> None:
        self._robots[copies], self._bodies[copies] = robots, bodies
        self._layouts[copies], self._limits[copies] = layouts[copies], limits
        for b in copies.tolist():
            self._copies[b] = self._start(b)

    def _start(self, b: int) -> _Copy:
        model, used = self._world.compile(self._layouts[b], self._limits[b]), self._copies[b]
        data = mujoco.MjData(model) if used is None else used.data  # all models have its sizes
        mujoco.mj_resetData(model, data)
        numbers = data.warning.number
        copy = _Copy(model, data, model.opt, data.ctrl, data.qpos, data.qvel, numbers)
        rows = (*self._robots[b], *self._bodies[b])
        for k, (row, (place, speed, on_wheels)) in enumerate(zip(rows, self._joints, strict=True)):
            positions, velocities = copy.positions[place:], copy.velocities[speed:]
            if on_wheels:
                start_wheeled(row, positions, velocities)
                continue
            positions[:2], velocities[:2] = row[:2], row[2:4]
            if k >= self._robots.shape[1]:
                positions[3], velocities[3] = np.arctan2(row[5], row[4]), row[6]
        return copy

    def step(
        self, active: Bool, commands: Double, contacts: Contacts, events: Counts, states: Float
    ) -> None:
        for b in np.flatnonzero(active).tolist():
            copy = self._copies[b]
            if copy is None:
                raise RuntimeError(f"copy {b} was stepped before its first reset")
            self._advance(b, copy, commands, contacts, events)
            _write(b, self._robots, self._bodies, states)

    def _advance(
        self, b: int, copy: _Copy, commands: Double, contacts: Contacts, events: Counts
    ) -> None:
        """Makes one control step of copy `b`."""
        for k in range(self._n_substeps):
            is_open = _push(
                b, k, self._robots, commands, self._limits, self._n_substeps, self._dt,
                self._accelerations, copy.forces, self._can_be_free, self._radii, self._half,
                self._layouts, self._joints, contacts.slack,
            )  # fmt: skip
            n_steps = 1 if is_open else self._n_short
            copy.option.timestep = self._dt / n_steps
            copy.option.disableflags = NO_CONTACTS if is_open else NO_MIDPHASE
            for _ in range(n_steps):
                if self._has_wheels:
                    _steer(
                        b, self._robots, commands, self._limits, self._radii, self._joints,
                        copy.forces,
                    )  # fmt: skip
                mujoco.mj_step(copy.model, copy.data)
                _read(
                    b, copy.positions, copy.velocities, self._robots, self._bodies, self._radii,
                    self._half, self._layouts, self._joints, *contacts, events,
                )  # fmt: skip
        _check_warnings(copy.warnings)


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
    """Checks that MuJoCo had room for all contacts, and did not start anew after diverging.

    Raises:
        SimulationError: it warned.
    """
    if numbers.any():
        kinds = [mujoco.mjtWarning(k).name for k in np.flatnonzero(numbers).tolist()]
        raise SimulationError(
            f"MuJoCo {mujoco.__version__} warned in a world: {', '.join(kinds)}, expected no "
            "warning; its positions cannot be trusted. Use fewer robots or a shorter physics_dt, "
            "or backend pymunk."
        )
