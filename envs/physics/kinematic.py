"""A backend without contacts: robots drive through each other and through everything else.

It shows what a task needs of a simulator, and separates a task's own rules from physics in tests.
Movable bodies stay where they are.
"""

import numpy as np

from swarmdata.envs.physics.backend import Contacts, Plan, write_state
from swarmdata.envs.physics.dynamics import drive, limits_of
from swarmdata.runtime.kernels import kernel
from swarmdata.types import Bool, Counts, Double, Float, Int


@kernel
def _advance(
    active: Bool,
    commands: Double,
    limits: Double,
    timing: tuple[int, float],
    robots: Double,
    bodies: Double,
    states: Float,
) -> None:
    """Moves the robots of the active copies: first positions, then velocities, as Munk2D does."""
    accelerations = np.empty((robots.shape[1], 2))
    for b in range(robots.shape[0]):
        if not active[b]:
            continue
        for k in range(timing[0]):
            drive(robots[b], commands[b], limits, timing, k, accelerations)
            for i in range(robots.shape[1]):
                for c in range(2):
                    robots[b, i, c] += robots[b, i, 2 + c] * timing[1]
                    robots[b, i, 2 + c] += accelerations[i, c] * timing[1]
        write_state(robots[b], bodies[b], states[b])


class KinematicBackend:
    """The backend interface without physics."""

    def __init__(self, plan: Plan, n_copies: int) -> None:
        spec = plan.spec
        self._limits, self._timing = limits_of(spec), (spec.n_substeps, spec.physics_dt)
        self._robots: Double = np.zeros((n_copies, spec.n_agents, 6))
        self._bodies: Double = np.zeros((n_copies, len(plan.movables), 7))

    def reset(self, copies: Int, layouts: Float, robots: Double, bodies: Double) -> None:
        self._robots[copies], self._bodies[copies] = robots[copies], bodies[copies]

    def step(
        self, active: Bool, commands: Double, contacts: Contacts, events: Counts, states: Float
    ) -> None:
        _advance(active, commands, self._limits, self._timing, self._robots, self._bodies, states)
