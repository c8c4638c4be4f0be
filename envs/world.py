"""The world that tasks run in: robots under commands, and their contacts."""

import math

import numpy as np
from numba import njit

from swarmdata.envs.backend import Backend, Contacts
from swarmdata.envs.munk import MunkBackend, load_addresses
from swarmdata.envs.pymunk_space import PublicBackend
from swarmdata.errors import SpecError
from swarmdata.spec import TaskSpec
from swarmdata.types import Bool, Double, Float, Int


def check_available(spec: TaskSpec) -> None:
    """Refuses what the worlds of this version cannot run; nothing in a spec is ever ignored.

    Raises:
        SpecError: naming the field and what it may be.
    """
    asked = [
        (f"team.{i}.robot.dynamics", str(role.robot.dynamics), "holonomic")
        for i, role in enumerate(spec.team)
    ]
    asked.append(("observation.kind", spec.observation.kind, "state"))
    asked.append(("communication.kind", spec.communication.kind, "none"))
    for path, value, available in asked:
        if value != available:
            raise SpecError(
                f"{path}: {value!r} cannot be run by task {spec.task!r} version {spec.version}, "
                f"only {available!r}"
            )


def make_backend(spec: TaskSpec, n_copies: int) -> Backend:
    """Returns the fast backend, or the public one where Pymunk's private names are missing."""
    calls = load_addresses()
    return PublicBackend(spec, n_copies) if calls is None else MunkBackend(spec, n_copies, calls)


@njit(nogil=True, cache=True)
def command_accelerations(
    actions: Double, velocities: Double, limits: Double, dt: float, active: Bool, out: Double
) -> bool:
    """Turns commands into accelerations that are held for one control step.

    The norm of a command is clipped to 1. A velocity command is tracked as well as the acceleration
    limit allows within the step.

    Args:
        actions: commands, [E, N, 2].
        velocities: m/s, [E, N, 2].
        limits: per robot: maximum speed, maximum acceleration, 1 for velocity commands, [N, 3].
        dt: control step, s.
        active: copies to compute, [E].
        out: written, m/s^2, [E, N, 2].

    Returns:
        False if a command of an active copy is not finite.
    """
    for b in range(actions.shape[0]):
        if not active[b]:
            continue
        for i in range(actions.shape[1]):
            ax, ay = float(actions[b, i, 0]), float(actions[b, i, 1])
            if not (math.isfinite(ax) and math.isfinite(ay)):
                return False
            norm = math.sqrt(ax * ax + ay * ay)
            if norm > 1.0:
                ax, ay = ax / norm, ay / norm
            top, most = limits[i, 0], limits[i, 1]
            if limits[i, 2] == 1.0:
                ax = (top * ax - velocities[b, i, 0]) / dt
                ay = (top * ay - velocities[b, i, 1]) / dt
                norm = math.sqrt(ax * ax + ay * ay)
                if norm > most:
                    ax, ay = ax * most / norm, ay * most / norm
            else:
                ax, ay = most * ax, most * ay
                vx, vy = velocities[b, i, 0] + ax * dt, velocities[b, i, 1] + ay * dt
                speed = math.sqrt(vx * vx + vy * vy)
                if speed > top:  # the speed limit holds for acceleration commands too
                    ax = (vx * top / speed - velocities[b, i, 0]) / dt
                    ay = (vy * top / speed - velocities[b, i, 1]) / dt
            out[b, i, 0] = ax
            out[b, i, 1] = ay
    return True


class World:
    """E copies of robots among obstacles; knows no task.

    `contacts.events` holds the events of the last step of each copy.
    """

    def __init__(self, spec: TaskSpec, n_copies: int) -> None:
        check_available(spec)
        n, m = spec.n_agents, _n_obstacles(spec)
        self.radii: Double = np.array([robot.radius for robot in spec.robots])
        self.half: Double = np.array([spec.arena.width / 2, spec.arena.height / 2])
        self.layouts: Float = np.zeros((n_copies, m, 8), dtype=np.float32)
        self.contacts = Contacts(
            robots=np.zeros((n_copies, n, n), dtype=np.bool_),
            obstacles=np.zeros((n_copies, n, m + 4), dtype=np.bool_),
            slack=np.zeros((n_copies, n, 3)),
            events=np.zeros((n_copies, n, 4), dtype=np.uint8),
        )
        self.backend = make_backend(spec, n_copies)
        self._control_dt = spec.control_dt
        self._limits = np.array(
            [(r.max_speed, r.max_acceleration, r.command == "velocity") for r in spec.robots],
            dtype=np.float64,
        )
        self._accelerations: Double = np.zeros((n_copies, n, 2))

    def reset(self, copies: Int, starts: Double) -> None:
        """Starts worlds in `copies` from `self.layouts`; robots rest at `starts` [E, N, 2]."""
        for array in self.contacts:
            array[copies] = 0
        self.backend.reset(copies, self.layouts, starts)

    def step(self, actions: Float | Double, active: Bool) -> bool:
        """Advances the active copies by one control step; False if an action is not finite."""
        finite: bool = command_accelerations(
            actions,
            self.backend.velocities,
            self._limits,
            self._control_dt,
            active,
            self._accelerations,
        )
        if finite:
            self.backend.step(active, self._accelerations, self.contacts)
        return finite


def _n_obstacles(spec: TaskSpec) -> int:
    o = spec.obstacles
    return o.circles + o.boxes + o.corners + o.pockets
