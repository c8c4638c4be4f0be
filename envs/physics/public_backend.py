"""Builds worlds in Pymunk, and simulates them through Pymunk's public interface only.

Every space is built anew, at reset and after free motion. `fast_backend` must give the same bits,
ten times faster; this one takes over where the private names that it needs are missing.
"""

import atexit
import math
from collections.abc import Sequence
from weakref import WeakSet

import numpy as np
import pymunk

from swarmdata.envs.physics.backend import Contacts, Moving, Plan, write_state
from swarmdata.envs.physics.contacts import update_contacts
from swarmdata.envs.physics.dynamics import FRICTION, MASS, N_LIMITS, drive
from swarmdata.envs.physics.episode_bodies import (
    IS_ELLIPSOID,
    MOMENT,
    N_PAYLOAD,
    PAYLOAD_MASS,
    SLIDE_FRICTION,
    TURN_FRICTION,
    floor_grip,
)
from swarmdata.envs.physics.free_motion import is_free, move
from swarmdata.envs.physics.impacts import time_to_impact
from swarmdata.numerics.geometry import BOX, CIRCLE, bar_box
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.rules import Payload
from swarmdata.specs.task_spec import SURFACE_FRICTION
from swarmdata.types import Bool, Counts, Double, Float, Int

COLLISION_SLOP = 0.002  # m of overlap that Munk2D tolerates at rest; its default is for pixels

SOLVER_ITERATIONS = 10


@kernel
def bars(row: Float, out: Double) -> int:
    """Writes the corners of the obstacle's bars, counter-clockwise, m, [3, 4, 2]; returns how many.

    `row`: one obstacle, [8]. The first corner is the one with the smallest x, then y: the order
    that Munk2D's convex hull gives, so that a shape built by hull and one written in place have the
    same vertices.
    """
    x, y, ux, uy = float(row[1]), float(row[2]), float(row[3]), float(row[4])
    a, b, t = float(row[5]), float(row[6]), float(row[7])
    n_bars = int(row[0])  # shape codes count bars: circle 0, box 1, corner 2, pocket 3
    local = np.empty((4, 2))
    for k in range(n_bars):
        cx, cy, hx, hy = bar_box(row[0], a, b, t, k)
        first = 0
        for c in range(4):
            lx = cx + hx if c in (1, 2) else cx - hx
            ly = cy + hy if c in (2, 3) else cy - hy
            local[c, 0] = x + lx * ux - ly * uy
            local[c, 1] = y + lx * uy + ly * ux
            lower = local[c, 1] < local[first, 1]
            if local[c, 0] < local[first, 0] or (local[c, 0] == local[first, 0] and lower):
                first = c
        for c in range(4):
            out[k, c, 0] = local[(first + c) % 4, 0]
            out[k, c, 1] = local[(first + c) % 4, 1]
    return n_bars


def n_static_shapes(kinds: Int) -> int:
    """Number of collision shapes of all obstacles, walls not counted; at least one each."""
    return int(np.maximum(kinds, 1).sum())


def shapes_of(plan: Plan) -> Double:
    """Shape code, half length and half width (m; radius of a circle) of movable bodies, [K, 3]."""
    rows = [
        (CIRCLE, body.half_length, body.half_length)
        if body.shape == "circle"
        else (BOX, body.half_length, body.half_width)
        for body in plan.movables
    ]
    return np.array(rows, dtype=np.float64).reshape(-1, 3)


def _movable(
    space: pymunk.Space, payload: Payload, row: list[float], pose: list[float]
) -> pymunk.Shape:
    """Adds a body, whose friction is two joints of limited force; returns its shape, not added."""
    body = pymunk.Body(row[PAYLOAD_MASS], row[MOMENT])
    body.position, body.angle = (pose[0], pose[1]), math.atan2(pose[5], pose[4])
    slide = pymunk.PivotJoint(space.static_body, body, (0, 0), (0, 0))
    turn = pymunk.GearJoint(space.static_body, body, 0.0, 1.0)
    slide.max_bias = turn.max_bias = 0.0
    slide.max_force, turn.max_force = row[SLIDE_FRICTION], row[TURN_FRICTION]
    space.add(body, slide, turn)
    if payload.shape == "circle":
        return pymunk.Circle(body, payload.half_length)
    return pymunk.Poly.create_box(body, (2 * payload.half_length, 2 * payload.half_width))


def _static_shapes(ground: pymunk.Body, plan: Plan, layout: Float) -> list[pymunk.Shape]:
    spec = plan.spec
    t = spec.arena.wall_thickness
    x, y = spec.arena.width / 2 + t, spec.arena.height / 2 + t
    posts = [(-x, -y), (x, -y), (x, y), (-x, y)]
    shapes: list[pymunk.Shape] = [
        pymunk.Segment(ground, posts[i], posts[(i + 1) % 4], t) for i in range(4)
    ]
    corners = np.empty((3, 4, 2))
    for row in layout:
        if row[0] == CIRCLE:
            shapes.append(pymunk.Circle(ground, float(row[5]), (float(row[1]), float(row[2]))))
        else:
            n_bars = bars(row, corners)
            shapes += [
                pymunk.Poly(ground, [tuple(v) for v in bar]) for bar in corners[:n_bars].tolist()
            ]
    return shapes


def build_space(
    plan: Plan, layout: Float, robots: Double, movables: Double, limits: Double, payloads: Double
) -> tuple[pymunk.Space, list[pymunk.Body]]:
    """Builds one world: walls, obstacles in layout order, robots, then movable bodies, at rest.

    Args:
        plan: the obstacles and bodies of the world.
        layout: obstacles, [M, 8].
        robots: [N, 6].
        movables: [K, 7].
        limits: `dynamics.limits_of`, [N, 9].
        payloads: `episode_bodies.payload_rows`, [K, 5].

    Returns:
        The space, and the bodies of robots and movables.
    """
    spec = plan.spec
    space = pymunk.Space()
    _SPACES.add(space)
    space.collision_slop = COLLISION_SLOP
    space.iterations = SOLVER_ITERATIONS
    space.damping = 1.0  # drag is part of the robots, not of the world
    shapes = _static_shapes(space.static_body, plan, layout)
    bodies = []
    for robot, row, (x, y) in zip(spec.robots, limits, robots[:, :2].tolist(), strict=True):
        body = pymunk.Body(float(row[MASS]), float("inf"))
        body.position = x, y
        shapes.append(pymunk.Circle(body, robot.radius))
        bodies.append(body)
    space.add(*bodies)
    for payload, row, pose in zip(plan.movables, payloads.tolist(), movables.tolist(), strict=True):
        shapes.append(_movable(space, payload, row, pose))
        bodies.append(shapes[-1].body)
    for shape in shapes:
        shape.friction, shape.elasticity = SURFACE_FRICTION, 0.0
    first = len(shapes) - len(bodies)
    for shape, row in zip(shapes[first : first + len(limits)], limits, strict=True):
        shape.friction = float(row[FRICTION])
    space.add(*shapes)
    return space, bodies


class PublicBackend:
    """Implements `Backend` through attributes; slow, and the reference for the fast backend."""

    def __init__(self, plan: Plan, n_copies: int) -> None:
        self._plan, spec = plan, plan.spec
        n = spec.n_agents
        self._limits: Double = np.zeros((n_copies, n, N_LIMITS))
        self._payloads: Double = np.zeros((n_copies, len(plan.movables), N_PAYLOAD))
        self._radii = np.array([robot.radius for robot in spec.robots])
        self._half = np.array(spec.half_size)
        self._shapes = shapes_of(plan)
        self._worlds: list[tuple[pymunk.Space, list[pymunk.Body]] | None] = [None] * n_copies
        self._layouts: dict[int, Float] = {}
        self._accelerations: Double = np.zeros((n, 2))
        self._travel: Double = np.zeros(n)
        self._robots: Double = np.zeros((n_copies, n, 6))
        self._bodies: Double = np.zeros((n_copies, len(plan.movables), 7))

    def reset(self, copies: Int, layouts: Float, moving: Moving) -> None:
        self._robots[copies], self._bodies[copies] = moving.robots, moving.bodies
        self._limits[copies], self._payloads[copies] = moving.limits, moving.payloads
        for b in copies.tolist():
            self._layouts[b] = layouts[b].copy()
            self._worlds[b] = self._new_world(b) if self._plan.movables else None

    def _new_world(self, b: int) -> tuple[pymunk.Space, list[pymunk.Body]]:
        robots, movables = self._robots[b], self._bodies[b]
        space, bodies = build_space(
            self._plan, self._layouts[b], robots, movables, self._limits[b], self._payloads[b]
        )
        for body, row in zip(bodies, [*robots.tolist(), *movables.tolist()], strict=True):
            body.velocity = row[2], row[3]
        for body, row in zip(bodies[len(robots) :], movables.tolist(), strict=True):
            body.angular_velocity = row[6]
        return space, bodies

    def step(
        self, active: Bool, commands: Double, contacts: Contacts, events: Counts, states: Float
    ) -> None:
        n_substeps, dt = self._plan.spec.n_substeps, self._plan.spec.physics_dt
        for b in np.flatnonzero(active).tolist():
            if b not in self._layouts:
                raise RuntimeError(f"copy {b} was stepped before its first reset")
            robots = self._robots[b]
            of_copy = Contacts._make(array[b] for array in contacts)
            for k in range(n_substeps):
                drive(robots, commands[b], self._limits[b], n_substeps, dt, k, self._accelerations)
                if self._is_free(b, of_copy.slack):
                    self._worlds[b] = None
                    of_copy.robots[:], of_copy.obstacles[:] = False, False
                    move(robots, self._accelerations, dt)
                else:
                    self._solve(b, of_copy, events[b])
            write_state(robots, self._bodies[b], states[b])

    def _is_free(self, b: int, slack: Double) -> bool:
        dt, layout = self._plan.spec.physics_dt, self._layouts[b]
        return not self._plan.movables and is_free(
            self._robots[b], dt, self._travel, self._radii, layout, self._half, slack
        )

    def _solve(self, b: int, contacts: Contacts, events: Counts) -> None:
        """Makes one physics step of a copy in which something may touch."""
        robots, movables, layout = self._robots[b], self._bodies[b], self._layouts[b]
        left = dt = self._plan.spec.physics_dt
        while left > 0.0:
            part = time_to_impact(
                robots, movables, left, dt, self._radii, self._shapes, layout, self._half,
                contacts.slack,
            )  # fmt: skip
            left -= part
            space, bodies = self._solver(b, part)
            for body, row in zip(bodies, self._accelerations.tolist(), strict=False):
                body.force = (body.mass * row[0], body.mass * row[1])
            joints = list(space.constraints)
            for j, (body, load) in enumerate(zip(movables, self._payloads[b], strict=True)):
                if load[IS_ELLIPSOID]:
                    slide, turn = joints[2 * j : 2 * j + 2]
                    slide.max_force, turn.max_force = floor_grip(body, load)
            space.step(part)
            _read(bodies, robots, movables)
            update_contacts(robots, self._radii, layout, self._half, *contacts, events)

    def _solver(self, b: int, part: float) -> tuple[pymunk.Space, list[pymunk.Body]]:
        """The space of a copy; anew where the length of steps, which scales impulses, changes."""
        space, bodies = self._worlds[b] or self._new_world(b)
        if space.current_time_step not in (0.0, part):
            if self._plan.movables:  # a new space would not have the impulses of joints
                shapes = [shape for body in bodies for shape in body.shapes]
                space.remove(*shapes)
                space.add(*shapes)
            else:
                space, bodies = self._new_world(b)
        self._worlds[b] = space, bodies
        return space, bodies


def _read(bodies: Sequence[pymunk.Body], robots: Double, movables: Double) -> None:
    """Reads robots [N, 6] and movable bodies [K, 7] from the bodies of a space."""
    n = len(robots)
    for robot, body in zip(robots, bodies[:n], strict=True):
        robot[:4] = *body.position, *body.velocity
    for row, body in zip(movables, bodies[n:], strict=True):
        row[:] = *body.position, *body.velocity, *body.rotation_vector, body.angular_velocity


_SPACES: WeakSet[pymunk.Space] = WeakSet()
"""Left, with all that is in them, to the process if they outlive the interpreter."""


@atexit.register
def _leave_to_the_process() -> None:
    """Takes the callbacks away from all spaces that are left, and from what is in them."""
    for space in _SPACES:
        joints = (joint._constraint for joint in space.constraints)
        shapes = (shape._shape for shape in space.shapes)
        bodies = (body._body for body in (space.static_body, *space.bodies))
        for owned in (space._space, *joints, *shapes, *bodies):
            pymunk.space.ffi.gc(owned, None)
