"""The `lidar` model: a range scan with hit types in the body's frame, and the target in polar form.

Every object is brought into the body's frame once, and the innermost loops run over a block of rays
in float32, of constant size and with one scratch array: only then are they vectorised. The bits are
the same everywhere, since nothing is contracted or reordered.
"""

import math

import numpy as np

from swarmdata.numerics.geometry import CIRCLE, bar_box
from swarmdata.perception.sensing.measured_world import Sense, World
from swarmdata.perception.sensing.modifiers import echoes_of
from swarmdata.perception.sensing.sensed_scene import (
    N_POLAR,
    POLAR_FEATURES,
    SCENE,
    Scene,
    gather,
    write_polar,
)
from swarmdata.runtime.argument_blocks import ArgumentBlock, unpack
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.features import Feature, numbered
from swarmdata.specs.sensing_models import LidarModel
from swarmdata.specs.state_layout import N_COLUMNS, UX, UY, X, Y
from swarmdata.types import Bool, Double, Float, Int

N_LANES = 16  # rays of a block

_COS, _SIN, _INV_X, _INV_Y, _BEST, _HIT = (N_LANES * row for row in range(6))
_ZERO, _ONE, _TINY = np.float32(0), np.float32(1), np.float32(1e-9)
_NOTHING, _ROBOT, _OBSTACLE, _WALL, _PAYLOAD = (np.float32(code) for code in range(5))

HIT_CHANNELS = ("robot", "obstacle", "wall", "payload")
"""Channels of a beam's hit type; the last only in tasks with movable bodies."""


def lidar_sense(model: LidarModel, scene: Scene) -> Sense:
    """Features: `POLAR_FEATURES`, then for each beam its distance and a flag for each hit type.

    The distance is 1 at the model's range, and if nothing is within the robot's range. The first
    beam points along the heading, the others follow counter-clockwise.
    """
    channels = HIT_CHANNELS if len(scene.bodies) else HIT_CHANNELS[:3]
    beam = (
        Feature("distance", "range", "", "of the first hit / range of the model; 1: no hit"),
        *(Feature(name, "flag", "", f"1 if the beam hits: {name}") for name in channels),
    )
    features = (*POLAR_FEATURES, *numbered("beam", model.n_rays, beam))
    rays = ray_blocks(model.n_rays)
    block = ArgumentBlock(scene._replace(n_parts=model.n_rays, span=model.range, rays=rays), SCENE)

    def sense(world: World, robots: range, active: Bool, out: Float) -> None:
        scan(
            block.packed, world.true_states, world.true_layouts, world.states, robots.start,
            robots.stop, active, out,
        )  # fmt: skip

    return Sense(features, echoes_of(features), sense)


def ray_blocks(n_rays: int) -> Float:
    """Unit vectors of the rays in the body's frame, [blocks, 2, N_LANES]; spare lanes repeat ray 0.

    Cosines and sines are rounded to multiples of 2**-20 and normalised, so that they do not depend
    on the last bits of a platform's functions.
    """
    angles = 2 * np.pi * np.arange(n_rays) / n_rays
    x, y = (np.round(f(angles) * 2**20) / 2**20 for f in (np.cos, np.sin))
    norm = np.sqrt(x * x + y * y)
    blocks = np.zeros((-(-n_rays // N_LANES), 2, N_LANES), dtype=np.float32)
    blocks[:, 0] = 1
    k = np.arange(n_rays)
    blocks[k // N_LANES, 0, k % N_LANES] = x / norm
    blocks[k // N_LANES, 1, k % N_LANES] = y / norm
    return blocks


@kernel(error_model="numpy")
def _invert(lanes: Float, ax: np.float32, ay: np.float32) -> None:
    """Reciprocals of every ray's components, at least 1e-9, in a frame whose x axis is (ax, ay)."""
    for k in range(N_LANES):
        c, s = lanes[_COS + k], lanes[_SIN + k]
        x, y = c * ax + s * ay, s * ax - c * ay
        lanes[_INV_X + k] = _ONE / (x if abs(x) > _TINY else _TINY)
        lanes[_INV_Y + k] = _ONE / (y if abs(y) > _TINY else _TINY)


@kernel(error_model="numpy")
def _start(lanes: Float, rays: Float, robot: Float, half: Double, reach: np.float32) -> None:
    """Starts the scan of a block: the wall that each ray meets, or nothing within `reach`."""
    for k in range(N_LANES):
        lanes[_COS + k] = rays[0, k]
        lanes[_SIN + k] = rays[1, k]
    _invert(lanes, robot[UX], -robot[UY])
    px, py, hx, hy = robot[X], robot[Y], np.float32(half[0]), np.float32(half[1])
    for k in range(N_LANES):
        ix, iy = lanes[_INV_X + k], lanes[_INV_Y + k]
        tx = hx * abs(ix) - px * ix
        ty = hy * abs(iy) - py * iy
        t = tx if tx < ty else ty
        t = t if t > _ZERO else _ZERO
        lanes[_BEST + k] = t if t < reach else reach
        lanes[_HIT + k] = _WALL if t < reach else _NOTHING


@kernel(error_model="numpy")
def _circle(lanes: Float, x: np.float32, y: np.float32, r: np.float32, code: np.float32) -> None:
    """Updates the nearest hit of each ray with a circle about (x, y) in the body's frame."""
    rr = r * r
    for k in range(N_LANES):
        c, s, best = lanes[_COS + k], lanes[_SIN + k], lanes[_BEST + k]
        along, across = c * x + s * y, c * y - s * x
        square = rr - across * across
        root = math.sqrt(square if square > _ZERO else _ZERO)
        near = along - root
        t = near if near > _ZERO else _ZERO
        closer = (square >= _ZERO) & (along + root >= _ZERO) & (t < best)
        lanes[_BEST + k] = t if closer else best
        lanes[_HIT + k] = code if closer else lanes[_HIT + k]


@kernel(error_model="numpy")
def _bar(
    lanes: Float, x: np.float32, y: np.float32, hx: np.float32, hy: np.float32, code: np.float32
) -> None:
    """Updates the nearest hit of each ray with a bar, by the method of slabs.

    (Kay and Kajiya, "Ray tracing complex scenes", SIGGRAPH 1986.) The lanes hold the reciprocals in
    the bar's frame, in which its centre is at (x, y) from the robot.
    """
    for k in range(N_LANES):
        ix, iy, best = lanes[_INV_X + k], lanes[_INV_Y + k], lanes[_BEST + k]
        mx, my, ex, ey = x * ix, y * iy, hx * abs(ix), hy * abs(iy)
        enter_x, enter_y, leave_x, leave_y = mx - ex, my - ey, mx + ex, my + ey
        near = enter_x if enter_x > enter_y else enter_y
        far = leave_x if leave_x < leave_y else leave_y
        t = near if near > _ZERO else _ZERO
        closer = (near <= far) & (far >= _ZERO) & (t < best)
        lanes[_BEST + k] = t if closer else best
        lanes[_HIT + k] = code if closer else lanes[_HIT + k]


@kernel(error_model="numpy")
def _shape(
    lanes: Float, row: Double, dx: float, dy: float, ux: float, uy: float, code: np.float32
) -> None:
    """Updates the hits with a shape's bars, at (dx, dy) from a robot with heading (ux, uy)."""
    ax, ay = row[3], row[4]
    _invert(lanes, np.float32(ux * ax + uy * ay), np.float32(ux * ay - uy * ax))
    lx, ly = dx * ax + dy * ay, dy * ax - dx * ay
    for index in range(int(row[0])):
        cx, cy, hx, hy = bar_box(row[0], row[5], row[6], row[7], index)
        x, y = np.float32(lx + cx), np.float32(ly + cy)
        _bar(lanes, x, y, np.float32(hx), np.float32(hy), code)


@kernel(error_model="numpy")
def _objects(
    lanes: Float,
    state: Float,
    i: int,
    radii: Double,
    rows: Double,
    sizes: Double,
    n_obstacles: int,
    reach: float,
) -> None:
    """Meets every robot, obstacle and movable body that robot i can reach."""
    at = N_COLUMNS * i
    px, py = float(state[at + X]), float(state[at + Y])
    ux, uy = float(state[at + UX]), float(state[at + UY])
    for j in range(radii.shape[0]):
        dx = float(state[N_COLUMNS * j + X]) - px
        dy = float(state[N_COLUMNS * j + Y]) - py
        bound = reach + radii[j]
        if j != i and dx * dx + dy * dy < bound * bound:
            x, y = np.float32(ux * dx + uy * dy), np.float32(ux * dy - uy * dx)
            _circle(lanes, x, y, np.float32(radii[j]), _ROBOT)
    for m in range(rows.shape[0]):
        dx, dy, bound = rows[m, 1] - px, rows[m, 2] - py, reach + sizes[m]
        if dx * dx + dy * dy < bound * bound:
            code = _OBSTACLE if m < n_obstacles else _PAYLOAD
            if rows[m, 0] == CIRCLE:
                x, y = np.float32(ux * dx + uy * dy), np.float32(ux * dy - uy * dx)
                _circle(lanes, x, y, np.float32(rows[m, 5]), code)
            else:
                _shape(lanes, rows[m], dx, dy, ux, uy, code)


@kernel(error_model="numpy")
def _write(lanes: Float, out: Float, n_rays: int, n_channels: int, scale: np.float32) -> None:
    """Writes the beams of one block, in units of `scale` metres."""
    for k in range(n_rays):
        hit, at = lanes[_HIT + k], (1 + n_channels) * k
        out[at] = _ONE if hit == _NOTHING else lanes[_BEST + k] / scale
        for channel in range(n_channels):
            out[at + 1 + channel] = _ONE if hit == np.float32(1 + channel) else _ZERO


@kernel(error_model="numpy")
def scan(
    packed: Int,  # `Scene`, of an `ArgumentBlock`
    states: Float,  # [E, S] true ones, which the beams meet
    layouts: Float,  # [E, M, 8] true obstacles
    measured: Float,  # [E, S] states as measured, for velocity and target
    first_robot: int,  # that observes
    end_robot: int,  # one past the last
    active: Bool,  # copies to observe, [E]; rows of the others are not written
    out: Float,  # [E, N, F] written
) -> None:
    """Writes the `lidar` observation of some robots in every active copy."""
    n_agents, radii, ranges, half, diagonal, bodies, _, n_rays, span, rays = unpack(packed, SCENE)
    n_obstacles, n_bodies = layouts.shape[1], bodies.shape[0]
    n_channels = 4 if n_bodies > 0 else 3
    rows = np.empty((n_obstacles + n_bodies, 8))
    sizes = np.empty(n_obstacles + n_bodies)
    lanes = np.empty(6 * N_LANES, dtype=np.float32)
    for b in range(states.shape[0]):
        if not active[b]:
            continue
        state = states[b]
        gather(state, layouts[b], n_agents, bodies, rows, sizes)
        for i in range(first_robot, end_robot):
            at, reach = N_COLUMNS * i, min(span, ranges[i])
            write_polar(out[b, i], measured[b], i, diagonal)
            for block in range(rays.shape[0]):
                _start(lanes, rays[block], state[at:], half, np.float32(reach))
                _objects(lanes, state, i, radii, rows, sizes, n_obstacles, reach)
                first, done = N_LANES * block, N_POLAR + (1 + n_channels) * N_LANES * block
                count = min(N_LANES, n_rays - first)
                _write(lanes, out[b, i, done:], count, n_channels, np.float32(span))
