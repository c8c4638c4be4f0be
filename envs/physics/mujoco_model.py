"""A world as a MuJoCo model: robots on planar joints, or on wheels, among static shapes.

All centres are at one height, where a sphere is a disc and a tall box a rectangle: gaps in the
plane are MuJoCo's distances. Robots have two slide joints: their heading is a command. Payloads
have a third, along which gravity presses them on the floor, and a hinge. They stand on one foot,
whose contact with the floor has the dry friction of the spec. MuJoCo's contacts are soft:
`LONGEST_STEP` bounds how deep bodies sink in, since a contact cannot be stiffer than a step allows.
A model is compiled once; the numbers of an episode, and all that the compiler derives from them but
its trees of boxes, which are switched off, are written into copies.
"""

import copy
import itertools
import math
from typing import Any, NamedTuple

import mujoco
import numpy as np

from swarmdata.envs.physics.backend import Plan
from swarmdata.envs.physics.dynamics import FRICTION, MASS
from swarmdata.envs.physics.episode_bodies import (
    MOMENT,
    PAYLOAD_MASS,
    SLIDE_FRICTION,
    TURN_FRICTION,
)
from swarmdata.envs.physics.mujoco_wheels import (
    FLOOR,
    GRAVITY,
    ON_FLOOR,
    WHEEL_RADIUS,
    Wheeled,
    add_wheeled,
)
from swarmdata.numerics.exact_math import sum_in_order
from swarmdata.numerics.geometry import CIRCLE, bar_box
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.rules import Payload
from swarmdata.specs.task_spec import SURFACE_FRICTION, Robot
from swarmdata.types import Double, Float, Int

LONGEST_STEP = 0.0125  # s, of MuJoCo's steps near contacts, a whole number in a physics step
DAMPING_RATIO = 2.0  # of contacts; at MuJoCo's default of 1, bodies bounce

BODY_FRICTION = SURFACE_FRICTION**2
"""Friction coefficient between payloads and what stands: the product of those of two bodies, as in
Munk2D. MuJoCo takes that of the geom of higher priority, which is the robot; pairs of robots have
their own."""

TALL = 1.0  # half height (m) of everything that is not a sphere
FRICTION_HARDNESS = 10.0  # MuJoCo's `impratio`; with less, what stands would creep
MEMORY_BYTES = 1 << 20  # for contacts and constraints of one copy; too little is an error
BODIES = 1  # class of collisions: bodies collide with bodies, and feet and wheels with the floor


def steps_in(physics_dt: float) -> int:
    """Number of MuJoCo's steps in a physics step near contacts."""
    return math.ceil(physics_dt / LONGEST_STEP - 1e-9)


@kernel
def _write_shapes(
    layout: Float, geoms: Int, pos: Double, quat: Double, size: Double, reach: Double, box: Double
) -> None:
    """Writes obstacles to the geoms of a model, as many as each has bars, at least one.

    Of G geoms: pos [G, 3], quat [G, 4], size [G, 3], radius of the bounding sphere, bounding box
    [G, 6].
    """
    s = 0
    for m in range(layout.shape[0]):
        row = layout[m].astype(np.float64)
        kind, x, y, ux, uy, a, b, t = row[0], row[1], row[2], row[3], row[4], row[5], row[6], row[7]
        for k in range(max(int(kind), 1)):
            g, s = geoms[s], s + 1
            pos[g], quat[g], size[g] = 0.0, 0.0, 0.0
            if kind == CIRCLE:
                pos[g, 0], pos[g, 1] = x, y
                quat[g, 0], size[g, 0], reach[g], box[g, 3:] = 1.0, a, a, a
                continue
            cx, cy, hx, hy = bar_box(kind, a, b, t, k)
            pos[g, 0], pos[g, 1] = x + cx * ux - cy * uy, y + cx * uy + cy * ux
            half = 0.5 * math.atan2(uy, ux)
            quat[g, 0], quat[g, 3] = math.cos(half), math.sin(half)
            size[g, 0], size[g, 1], size[g, 2] = hx, hy, TALL
            reach[g], box[g, 3:] = math.sqrt(hx * hx + hy * hy + TALL * TALL), size[g]


class _Planar(NamedTuple):
    body: Any
    hull: Any  # a geom

    def write(self, model: Any, row: list[float]) -> None:
        """Gives the robot the body of an episode, `dynamics.limits_of`, [9]."""
        model.body_mass[self.body.id] = row[MASS]
        model.geom_friction[self.hull.id, 0] = SURFACE_FRICTION * row[FRICTION]


class _Pushed(NamedTuple):
    body: Any
    foot: Any  # a geom

    def write(self, model: Any, row: list[float]) -> None:
        """Gives the payload the body of an episode, `episode_bodies.payload_rows`, [5]."""
        weight = row[PAYLOAD_MASS] * GRAVITY
        model.body_mass[self.body.id], model.body_inertia[self.body.id] = (
            row[PAYLOAD_MASS],
            row[MOMENT],
        )
        model.geom_friction[self.foot.id, :2] = (
            row[SLIDE_FRICTION] / weight,
            row[TURN_FRICTION] / weight,
        )


class WorldModel:
    """Gives the models of a plan's episodes, which differ in numbers only.

    Joints are x and y of each planar robot, `mujoco_wheels.N_POSITIONS` of each other one, then x,
    y, height and angle of each payload, in the world.
    """

    def __init__(self, plan: Plan) -> None:
        spec = plan.spec
        self.source = mujoco.MjSpec()  # models are made from it
        self.source.memory = MEMORY_BYTES * (1 + spec.n_agents // 8)
        option = self.source.option
        option.timestep = spec.physics_dt / steps_in(spec.physics_dt)
        has_floor = bool(plan.movables) or any(robot.base == "wheels" for robot in spec.robots)
        option.gravity = (0.0, 0.0, -GRAVITY if has_floor else 0.0)
        option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
        option.impratio = FRICTION_HARDNESS
        self._contact = {
            "friction": (BODY_FRICTION, 0.0, 0.0),
            "solref": (2.0 * option.timestep, DAMPING_RATIO),  # the quickest that is stable
            "contype": BODIES,
            "conaffinity": BODIES,
        }
        self._add_walls(plan)
        bars = [self._static(kind) for kind in plan.kinds.tolist() for _ in range(max(kind, 1))]
        self._robots = [self._add_robot(f"robot_{i}", robot) for i, robot in enumerate(spec.robots)]
        is_usual = spec.randomization.friction is None and all(
            robot.friction == SURFACE_FRICTION for robot in spec.robots
        )
        self._pairs = [] if is_usual else self._add_pairs(spec.n_agents)
        if has_floor:
            self._add_floor()
        self._payloads = [
            self._add_payload(f"payload_{k}", each) for k, each in enumerate(plan.movables)
        ]
        self._compiled = self.source.compile()
        self._bars: Int = np.array([bar.id for bar in bars], np.int64)

    def new(self) -> Any:
        """Returns a `mujoco.MjModel`, of which nothing has been written yet."""
        return copy.copy(self._compiled)

    def write_obstacles(self, model: Any, layout: Float) -> None:
        """Writes the obstacles of an episode, [M, 8]."""
        _write_shapes(
            layout, self._bars, model.geom_pos, model.geom_quat, model.geom_size,
            model.geom_rbound, model.geom_aabb,
        )  # fmt: skip

    def write_bodies(self, model: Any, data: Any, limits: Double, payloads: Double) -> None:
        """Writes what moves in an episode; leaves `data` at its start.

        `limits`: of the robots, [N, 9]. `payloads`: `episode_bodies.payload_rows`, [K, 5].
        """
        for robot, row in zip(self._robots, limits.tolist(), strict=True):
            robot.write(model, row)
        for payload, row in zip(self._payloads, payloads.tolist(), strict=True):
            payload.write(model, row)
        for pair, i, j in self._pairs:
            model.pair_friction[pair.id, :2] = limits[i, FRICTION] * limits[j, FRICTION]
        mujoco.mj_setConst(model, data)
        model.stat.meaninertia = sum_in_order(model.dof_M0.tolist()) / model.nv  # solver's unit

    def _add_robot(self, name: str, robot: Robot) -> "_Planar | Wheeled":
        if robot.base == "wheels":
            return add_wheeled(self.source, name, robot, self._contact)
        body = self._add_body(name)
        for axis in range(2):
            self._add_slide(body, f"{name}_{'xy'[axis]}", axis, is_driven=True)
        sphere, size = mujoco.mjtGeom.mjGEOM_SPHERE, (robot.radius, 0.0, 0.0)
        return _Planar(body, self._add_geom(body, sphere, size, name=name, priority=1))

    def _add_pairs(self, n_agents: int) -> list[tuple[Any, int, int]]:
        """Adds a contact of its own friction for every pair of robots."""
        found = []
        for i, j in itertools.combinations(range(n_agents), 2):
            pair = self.source.add_pair(geomname1=f"robot_{i}", geomname2=f"robot_{j}")
            pair.solref, pair.friction = self._contact["solref"], (1.0, 1.0, 0.0, 0.0, 0.0)
            found.append((pair, i, j))
        return found

    def _add_walls(self, plan: Plan) -> None:
        t, (x, y) = plan.spec.arena.wall_thickness, plan.spec.half_size
        for sign in (1.0, -1.0):
            for pos, size in (
                ((sign * (x + t), 0.0, 0.0), (t, y + 2.0 * t, TALL)),
                ((0.0, sign * (y + t), 0.0), (x + 2.0 * t, t, TALL)),
            ):
                self._add_geom(self.source.worldbody, mujoco.mjtGeom.mjGEOM_BOX, size, pos=pos)

    def _static(self, kind: float) -> Any:
        """Adds one shape of an obstacle, not in the middle, where MuJoCo would skip its pose."""
        shape = mujoco.mjtGeom.mjGEOM_SPHERE if kind == CIRCLE else mujoco.mjtGeom.mjGEOM_BOX
        turned = {"pos": (1.0, 1.0, 0.0), "quat": (0.6, 0.0, 0.0, 0.8)}
        return self._add_geom(self.source.worldbody, shape, (1.0, 1.0, 1.0), **turned)

    def _add_geom(self, body: Any, shape: Any, size: tuple[float, ...], **more: Any) -> Any:
        return body.add_geom(type=shape, size=size, mass=0.0, **{**self._contact, **more})

    def _add_body(self, name: str) -> Any:
        """Adds a body of 1 kg and 1 kg m^2 about every axis."""
        return self.source.worldbody.add_body(
            name=name, explicitinertial=True, mass=1.0, inertia=(1.0, 1.0, 1.0)
        )

    def _add_slide(self, body: Any, name: str, axis: int, *, is_driven: bool = False) -> None:
        direction = [0.0, 0.0, 0.0]
        direction[axis] = 1.0
        body.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=direction)
        if is_driven:  # a motor: its control is a force, N
            joint = mujoco.mjtTrn.mjTRN_JOINT
            self.source.add_actuator(name=name, target=name, trntype=joint)

    def _add_payload(self, name: str, payload: Payload) -> _Pushed:
        length, width, body = payload.half_length, payload.half_width, self._add_body(name)
        for axis in range(3):
            self._add_slide(body, f"{name}_{'xyz'[axis]}", axis)
        body.add_joint(name=f"{name}_angle", type=mujoco.mjtJoint.mjJNT_HINGE, axis=(0, 0, 1))
        if payload.shape == "circle":
            self._add_geom(body, mujoco.mjtGeom.mjGEOM_SPHERE, (length, 0.0, 0.0))
        else:
            self._add_geom(body, mujoco.mjtGeom.mjGEOM_BOX, (length, width, TALL / 2))
        sphere, size = mujoco.mjtGeom.mjGEOM_SPHERE, (WHEEL_RADIUS, 0.0, 0.0)
        return _Pushed(body, self._add_geom(body, sphere, size, condim=4, **ON_FLOOR))

    def _add_floor(self) -> None:
        """Adds a floor without friction: of both geoms in contact, the larger one is taken."""
        floor, place = mujoco.mjtGeom.mjGEOM_PLANE, (0.0, 0.0, -WHEEL_RADIUS)
        on_floor = {**ON_FLOOR, "contype": FLOOR, "conaffinity": 0, "friction": (0.0, 0.0, 0.0)}
        self._add_geom(
            self.source.worldbody, floor, (1.0, 1.0, 1.0), pos=place, condim=1, **on_floor
        )
