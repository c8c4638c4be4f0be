"""A world as a MuJoCo model: robots on planar joints, or on wheels, among static shapes.

All centres are at one height, where a sphere is a disc and a tall box a rectangle. So every gap in
the plane is MuJoCo's own distance, and the model has the shapes of `public_backend.build_space`.
Robots have two slide joints each: their heading is a command (`dynamics`), not a body's. Payloads
have a third slide joint, along which gravity presses them on the floor, and a hinge. They stand on
one foot, whose contact with the floor has the dry friction of the spec in every direction.

MuJoCo's contacts are soft: bodies sink into each other before they are stopped.
`LONGEST_STEP` bounds how deep, since a contact cannot be stiffer than a step allows.
"""

import itertools
import math
from typing import Any, NamedTuple

import mujoco

from swarmdata.envs.physics.backend import Plan
from swarmdata.envs.physics.dynamics import FRICTION, MASS
from swarmdata.envs.physics.mujoco_wheels import (
    FLOOR,
    GRAVITY,
    ON_FLOOR,
    WHEEL_RADIUS,
    Wheeled,
    add_wheeled,
)
from swarmdata.numerics.geometry import CIRCLE, bar_box
from swarmdata.specs.rules import Payload
from swarmdata.specs.task_spec import SURFACE_FRICTION, Robot
from swarmdata.types import Double, Float

LONGEST_STEP = 0.0125
"""Largest length (s) of MuJoCo's steps near contacts; a physics step has a whole number of them."""

DAMPING_RATIO = 2.0
"""Of contacts. At MuJoCo's default of 1, the overlap of one step is pushed out so fast that bodies
bounce."""

BODY_FRICTION = SURFACE_FRICTION**2
"""Friction coefficient between payloads and what stands: the product of those of two bodies, as in
Munk2D. MuJoCo takes that of the geom of higher priority, which is the robot; pairs of robots have
their own."""

TALL = 1.0
"""Half height (m) of everything that is not a sphere."""

FRICTION_HARDNESS = 10.0
"""MuJoCo's `impratio`: how much harder friction is than contact; else what stands would creep."""

MEMORY_BYTES = 1 << 20
"""Of contacts and constraints of one copy; with too little, the backend raises an error."""

BODIES = 1
"""Class of collisions: bodies collide with bodies, and feet and wheels with the floor."""


def steps_in(physics_dt: float) -> int:
    """Number of MuJoCo's steps in a physics step near contacts."""
    return math.ceil(physics_dt / LONGEST_STEP - 1e-9)


class _Planar(NamedTuple):
    """The parts of a robot on slides that episodes change."""

    body: Any
    hull: Any  # a geom

    def write(self, row: list[float]) -> None:
        """Gives the robot the body of an episode, `dynamics.limits_of`, [8]."""
        self.body.mass = row[MASS]
        self.hull.friction = (SURFACE_FRICTION * row[FRICTION], 0.0, 0.0)


class WorldModel:
    """Builds the models of a plan's episodes, which differ in their obstacles only."""

    def __init__(self, plan: Plan) -> None:
        spec = plan.spec
        self._model = mujoco.MjSpec()
        self._model.memory = MEMORY_BYTES * (1 + spec.n_agents // 8)
        option = self._model.option
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
        self._bars = [
            [self._static(kind) for _ in range(max(int(kind), 1))] for kind in plan.kinds.tolist()
        ]
        self._robots = [self._add_robot(f"robot_{i}", robot) for i, robot in enumerate(spec.robots)]
        is_usual = spec.randomization.friction is None and all(
            robot.friction == SURFACE_FRICTION for robot in spec.robots
        )
        self._pairs = [] if is_usual else self._add_pairs(spec.n_agents)
        if has_floor:
            self._add_floor()
        for k, payload in enumerate(plan.movables):
            self._add_payload(f"payload_{k}", payload)

    def compile(self, layout: Float, limits: Double) -> Any:
        """Returns the `mujoco.MjModel` of an episode.

        Positions of joints are those of bodies in the world, and angles those of payloads:
        x and y of each planar robot and `mujoco_wheels.N_POSITIONS` of each other one, then x, y,
        height and angle of each payload.

        Args:
            layout: its obstacles, [M, 8].
            limits: of its robots, `dynamics.limits_of`, [N, 8].
        """
        for row, geoms in zip(layout.tolist(), self._bars, strict=True):
            _, x, y, ux, uy, a, b, t = row
            for k, geom in enumerate(geoms):
                if row[0] == CIRCLE:
                    geom.pos, geom.size = (x, y, 0.0), (a, 0.0, 0.0)
                    continue
                cx, cy, hx, hy = bar_box(row[0], a, b, t, k)
                angle = math.atan2(uy, ux)
                geom.pos = (x + cx * ux - cy * uy, y + cx * uy + cy * ux, 0.0)
                geom.quat = (math.cos(angle / 2), 0.0, 0.0, math.sin(angle / 2))
                geom.size = (hx, hy, TALL)
        for robot, row in zip(self._robots, limits.tolist(), strict=True):
            robot.write(row)
        for pair, i, j in self._pairs:
            slide = limits[i, FRICTION] * limits[j, FRICTION]
            pair.friction = (slide, slide, 0.0, 0.0, 0.0)
        return self._model.compile()

    def _add_robot(self, name: str, robot: Robot) -> "_Planar | Wheeled":
        """Adds a robot on two driven slides, or on wheels."""
        if robot.base == "wheels":
            return add_wheeled(self._model, name, robot, self._contact)
        body = self._add_body(name, 1.0, 1.0)
        for axis in range(2):
            self._add_slide(body, f"{name}_{'xy'[axis]}", axis, is_driven=True)
        sphere, size = mujoco.mjtGeom.mjGEOM_SPHERE, (robot.radius, 0.0, 0.0)
        return _Planar(body, self._add_geom(body, sphere, size, name=name, priority=1))

    def _add_pairs(self, n_agents: int) -> list[tuple[Any, int, int]]:
        """Adds a contact of its own friction for every pair of robots."""
        found = []
        for i, j in itertools.combinations(range(n_agents), 2):
            pair = self._model.add_pair(geomname1=f"robot_{i}", geomname2=f"robot_{j}")
            pair.solref = self._contact["solref"]
            found.append((pair, i, j))
        return found

    def _add_walls(self, plan: Plan) -> None:
        t, (x, y) = plan.spec.arena.wall_thickness, plan.spec.half_size
        for sign in (1.0, -1.0):
            for pos, size in (
                ((sign * (x + t), 0.0, 0.0), (t, y + 2.0 * t, TALL)),
                ((0.0, sign * (y + t), 0.0), (x + 2.0 * t, t, TALL)),
            ):
                self._add_geom(self._model.worldbody, mujoco.mjtGeom.mjGEOM_BOX, size, pos=pos)

    def _static(self, kind: float) -> Any:
        """Adds one shape of an obstacle, whose place and size `compile` writes."""
        shape = mujoco.mjtGeom.mjGEOM_SPHERE if kind == CIRCLE else mujoco.mjtGeom.mjGEOM_BOX
        return self._add_geom(self._model.worldbody, shape, (1.0, 1.0, 1.0))

    def _add_geom(self, body: Any, shape: Any, size: tuple[float, ...], **more: Any) -> Any:
        return body.add_geom(type=shape, size=size, mass=0.0, **{**self._contact, **more})

    def _add_body(self, name: str, mass: float, moment: float) -> Any:
        """Adds a body of this moment of inertia (kg m^2) about every axis."""
        return self._model.worldbody.add_body(
            name=name, explicitinertial=True, mass=mass, inertia=(moment, moment, moment)
        )

    def _add_slide(self, body: Any, name: str, axis: int, *, is_driven: bool = False) -> None:
        direction = [0.0, 0.0, 0.0]
        direction[axis] = 1.0
        body.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=direction)
        if is_driven:  # a motor: its control is a force, N
            joint = mujoco.mjtTrn.mjTRN_JOINT
            self._model.add_actuator(name=name, target=name, trntype=joint)

    def _add_payload(self, name: str, payload: Payload) -> None:
        """Adds a body that slides on the floor; its friction is that of `public_backend`."""
        length, width, mass = payload.half_length, payload.half_width, payload.mass
        if payload.shape == "circle":
            moment, area = mass * length**2 / 2, math.pi * length**2
        else:
            moment, area = mass * (length**2 + width**2) / 3, 4 * length * width
        body = self._add_body(name, mass, moment)
        for axis in range(3):
            self._add_slide(body, f"{name}_{'xyz'[axis]}", axis)
        body.add_joint(name=f"{name}_angle", type=mujoco.mjtJoint.mjJNT_HINGE, axis=(0, 0, 1))
        if payload.shape == "circle":
            self._add_geom(body, mujoco.mjtGeom.mjGEOM_SPHERE, (length, 0.0, 0.0))
        else:
            self._add_geom(body, mujoco.mjtGeom.mjGEOM_BOX, (length, width, TALL / 2))
        slide = payload.friction / (mass * GRAVITY)
        turn = slide * 2 / 3 * math.sqrt(area / math.pi)  # m, of a disc of equal area
        on_floor = {
            "friction": (slide, turn, 0.0),
            "condim": 4,
            **ON_FLOOR,
        }
        foot = (WHEEL_RADIUS, 0.0, 0.0)
        self._add_geom(body, mujoco.mjtGeom.mjGEOM_SPHERE, foot, **on_floor)

    def _add_floor(self) -> None:
        """Adds a floor without friction: of both geoms in contact, the larger one is taken."""
        floor, place = mujoco.mjtGeom.mjGEOM_PLANE, (0.0, 0.0, -WHEEL_RADIUS)
        on_floor = {**ON_FLOOR, "contype": FLOOR, "conaffinity": 0, "friction": (0.0, 0.0, 0.0)}
        self._add_geom(
            self._model.worldbody, floor, (1.0, 1.0, 1.0), pos=place, condim=1, **on_floor
        )
