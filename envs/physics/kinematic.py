"""A backend without contacts: robots drive through everything, and movable bodies stay."""

from typing import Annotated, NamedTuple

import numpy as np

from swarmdata.envs.physics.backend import Contacts, Moving, Plan, write_state
from swarmdata.envs.physics.dynamics import N_LIMITS, drive
from swarmdata.envs.physics.free_motion import move
from swarmdata.runtime.argument_blocks import ArgumentBlock, bundle_type, unpack
from swarmdata.runtime.kernels import kernel
from swarmdata.types import Bool, Counts, Double, Float, Int


class Motion(NamedTuple):
    """What moves in E copies, and what is the same in all of their steps."""

    limits: Annotated[Double, 3]  # [E, N, 9] of `limits_of`
    n_substeps: int  # physics steps in a control step
    dt: float  # s, of a physics step
    robots: Annotated[Double, 3]  # [E, N, 6] columns as in `drive`
    bodies: Annotated[Double, 3]  # [E, K, 7] columns `state_layout.BODY`


MOTION = bundle_type(Motion)


@kernel
def _advance(packed: Int, active: Bool, commands: Double, states: Float) -> None:
    """Moves the robots of the active copies in packed `Motion`, whatever is in their way."""
    limits, n_substeps, dt, robots, bodies = unpack(packed, MOTION)
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
        self.motion = Motion(
            limits=np.zeros((n_copies, spec.n_agents, N_LIMITS)),
            n_substeps=spec.n_substeps,
            dt=spec.physics_dt,
            robots=np.zeros((n_copies, spec.n_agents, 6)),
            bodies=np.zeros((n_copies, len(plan.movables), 7)),
        )
        self._block = ArgumentBlock(self.motion, MOTION)

    def reset(self, copies: Int, layouts: Float, moving: Moving) -> None:
        self.motion.robots[copies], self.motion.bodies[copies] = moving.robots, moving.bodies
        self.motion.limits[copies] = moving.limits

    def step(
        self, active: Bool, commands: Double, contacts: Contacts, events: Counts, states: Float
    ) -> None:
        _advance(self._block.packed, active, commands, states)
