"""How a world is built in Pymunk, and a backend that uses only Pymunk's public interface.

This backend builds every space anew at reset. `envs.munk` does the same work about ten times
faster through Munk2D's own functions, and must give the same bits; this one takes over where the
private names are missing.
"""

import numpy as np
import pymunk

from swarmdata.envs.backend import Contacts
from swarmdata.envs.contacts import update_contacts
from swarmdata.geometry import BOX, CIRCLE, CORNER, N_BARS
from swarmdata.spec import TaskSpec
from swarmdata.types import Bool, Double, Float, Int

SLOP = 0.002
"""Overlap (m) that Munk2D leaves at rest; its default of 0.1 is meant for pixels."""

ITERATIONS = 10
FRICTION = 0.2


def bars(row: Float) -> Double:
    """Returns the corners of the obstacle's bars, [n_bars, 4, 2], counter-clockwise.

    The first corner is the one with the smallest x, then y: the order that Munk2D's convex hull
    gives, so that a shape built by hull and one written in place have the same vertices.
    """
    kind = float(row[0])
    x, y, ux, uy, a, b, t = (float(value) for value in row[1:])
    boxes = [(0.0, 0.0, a, b)] if kind == BOX else [(0.0, t - b, a, t), (t - a, 0.0, t, b), (a - t, 0.0, t, b)]
    n_bars = N_BARS[kind]
    out = np.empty((n_bars, 4, 2))
    for k, (cx, cy, hx, hy) in enumerate(boxes[:n_bars]):
        local = [(cx - hx, cy - hy), (cx + hx, cy - hy), (cx + hx, cy + hy), (cx - hx, cy + hy)]
        corners = [(x + lx * ux - ly * uy, y + lx * uy + ly * ux) for lx, ly in local]
        first = min(range(4), key=lambda c, corners=corners: corners[c])  # type: ignore[misc]
        out[k] = corners[first:] + corners[:first]
    return out


def n_static_shapes(spec: TaskSpec) -> int:
    """Number of shapes of all obstacles, without the walls."""
    o = spec.obstacles
    return o.circles + o.boxes + o.corners * N_BARS[CORNER] + o.pockets * 3


def _walls(spec: TaskSpec, body: pymunk.Body) -> list[pymunk.Shape]:
    t = spec.arena.wall_thickness
    x, y = spec.arena.width / 2 + t, spec.arena.height / 2 + t
    corners = [(-x, -y), (x, -y), (x, y), (-x, y)]
    return [pymunk.Segment(body, corners[i], corners[(i + 1) % 4], t) for i in range(4)]


def build_space(spec: TaskSpec, layout: Float, starts: Double) -> tuple[pymunk.Space, list[pymunk.Body]]:
    """Builds one world: walls, obstacles in layout order, then robots at rest.

    Args:
        spec: the task.
        layout: obstacles, [M, 8].
        starts: robot positions, m, [N, 2].
    """
    space = pymunk.Space()
    space.collision_slop = SLOP
    space.iterations = ITERATIONS
    space.damping = 1.0  # drag is part of the robots, not of the world
    ground = space.static_body
    shapes = _walls(spec, ground)
    for row in layout:
        if row[0] == CIRCLE:
            shapes.append(pymunk.Circle(ground, float(row[5]), (float(row[1]), float(row[2]))))
        else:
            shapes += [pymunk.Poly(ground, [tuple(v) for v in bar]) for bar in bars(row).tolist()]
    bodies = []
    for robot, (x, y) in zip(spec.robots, starts.tolist(), strict=True):
        body = pymunk.Body(1.0, float("inf"))
        body.position = x, y
        shapes.append(pymunk.Circle(body, robot.radius))
        bodies.append(body)
    for shape in shapes:
        shape.friction, shape.elasticity = FRICTION, 0.0
    space.add(*bodies)
    space.add(*shapes)
    return space, bodies


class PublicBackend:
    """The backend interface over attribute access; slow, and the reference for the fast one."""

    def __init__(self, spec: TaskSpec, n_copies: int) -> None:
        self._spec = spec
        self._radii = np.array([robot.radius for robot in spec.robots])
        self._half = np.array([spec.arena.width / 2, spec.arena.height / 2])
        self._worlds: list[tuple[pymunk.Space, list[pymunk.Body]] | None] = [None] * n_copies
        self._layouts: dict[int, Float] = {}
        self.positions: Double = np.zeros((n_copies, spec.n_agents, 2))
        self.velocities: Double = np.zeros((n_copies, spec.n_agents, 2))

    def reset(self, copies: Int, layouts: Float, starts: Double) -> None:
        for b in copies.tolist():
            self._layouts[b] = layouts[b].copy()
            self._worlds[b] = build_space(self._spec, layouts[b], starts[b])
            self.positions[b] = starts[b]
            self.velocities[b] = 0.0

    def step(self, active: Bool, accelerations: Double, contacts: Contacts) -> None:
        for b in np.flatnonzero(active).tolist():
            world = self._worlds[b]
            if world is None:
                raise RuntimeError(f"copy {b} was stepped before its first reset")
            space, bodies = world
            contacts.events[b] = 0
            for _ in range(self._spec.n_substeps):
                for body, force in zip(bodies, accelerations[b].tolist(), strict=True):
                    body.force = tuple(force)
                space.step(self._spec.physics_dt)
                self.positions[b] = [body.position for body in bodies]
                update_contacts(
                    self.positions[b], self._radii, self._layouts[b], self._half,
                    contacts.robots[b], contacts.obstacles[b], contacts.events[b],
                )  # fmt: skip
            self.velocities[b] = [body.velocity for body in bodies]
