"""A backend without contacts: robots drive through each other and through everything else.

It shows the least that a task needs from a simulator, and lets tests check a task's rules without
physics. Movable bodies stay where they are.
"""

import numpy as np

from swarmdata.envs.physics.backend import Contacts, Plan, write_state
from swarmdata.envs.physics.dynamics import drive
from swarmdata.envs.physics.free_motion import move
from swarmdata.runtime.kernels import kernel
from swarmdata.types import Bool, Counts, Double, Float, Int


@kernel
def _advance(
    active: Bool,
    commands: Double,
    limits: Double,
    n_substeps: int,
    dt: float,
    robots: Double,
    bodies: Double,
    states: Float,
) -> None:
    """Moves the robots of the active copies, whatever is in their way."""
    accelerations = np.empty((robots.shape[1], 2))
    for b in range(robots.shape[0]):
        if not active[b]:
            continue
        for k in range(n_substeps):
            drive(robots[b], commands[b], limits[b], n_substeps, dt, k, accelerations)
            move(robots[b], accelerations, dt)
        write_state(robots[b], bodies[b], states[b])


class KinematicBackend:
    """Implements `Backend` without contacts."""

    def __init__(self, plan: Plan, n_copies: int) -> None:
        spec = plan.spec
        self._limits: Double = np.zeros((n_copies, spec.n_agents, 8))
        self._n_substeps, self._dt = spec.n_substeps, spec.physics_dt
        self._robots: Double = np.zeros((n_copies, spec.n_agents, 6))
        self._bodies: Double = np.zeros((n_copies, len(plan.movables), 7))

    def reset(
        self, copies: Int, layouts: Float, robots: Double, bodies: Double, limits: Double
    ) -> None:
        self._robots[copies], self._bodies[copies] = robots, bodies
        self._limits = limits

    def step(
        self, active: Bool, commands: Double, contacts: Contacts, events: Counts, states: Float
    ) -> None:
        _advance(
            active, commands, self._limits, self._n_substeps, self._dt,
            self._robots, self._bodies, states,
        )  # fmt: skip
