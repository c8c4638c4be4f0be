"""The `bearing` model: ranges and bearings of the neighbours that are visible to a robot.

Visible: the segment between the centres crosses no obstacle, movable body or third robot.
"""

import math

import numpy as np

from swarmdata.numerics.geometry import CIRCLE
from swarmdata.numerics.sight import crosses_circle, crosses_shape
from swarmdata.perception.sensing.measured_world import Sense, World
from swarmdata.perception.sensing.modifiers import NO_ECHOES
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
from swarmdata.specs.features import Feature, numbered, vector
from swarmdata.specs.sensing_models import BearingModel
from swarmdata.specs.state_layout import N_COLUMNS, UX, UY, X, Y
from swarmdata.types import Bool, Double, Float, Int

NEIGHBOR_FEATURES = (
    Feature("range", "range", "", "distance between centers / range of the model"),
    *vector("bearing", "direction", "cosine and sine of its bearing"),
    Feature("mask", "flag", "", "1 if the slot holds a visible robot; nearest first"),
)
_SLOT_WIDTH = len(NEIGHBOR_FEATURES)


def bearing_sense(model: BearingModel, scene: Scene) -> Sense:
    """Features: `POLAR_FEATURES`, then a slot of `NEIGHBOR_FEATURES` for each visible neighbour.

    The nearest centre is first, as measured; a slot without a neighbour is zero.
    """
    slots = numbered("neighbor", model.n_neighbors, NEIGHBOR_FEATURES)
    block = ArgumentBlock(scene._replace(n_parts=model.n_neighbors, span=model.range), SCENE)

    def sense(world: World, robots: range, active: Bool, out: Float) -> None:
        observe_bearings(
            block.packed, world.true_states, world.true_layouts, world.states, robots.start,
            robots.stop, active, out,
        )  # fmt: skip

    return Sense((*POLAR_FEATURES, *slots), NO_ECHOES, sense)


@kernel
def _hidden(state: Float, i: int, j: int, radii: Double, rows: Double, sizes: Double) -> bool:
    """Whether anything stands between robots i and j."""
    px, py = float(state[N_COLUMNS * i + X]), float(state[N_COLUMNS * i + Y])
    dx, dy = float(state[N_COLUMNS * j + X]) - px, float(state[N_COLUMNS * j + Y]) - py
    for k in range(radii.shape[0]):
        if k not in (i, j):
            cx = float(state[N_COLUMNS * k + X]) - px
            cy = float(state[N_COLUMNS * k + Y]) - py
            if crosses_circle(dx, dy, cx, cy, radii[k]):
                return True
    for m in range(rows.shape[0]):
        cx, cy = rows[m, 1] - px, rows[m, 2] - py
        if crosses_circle(dx, dy, cx, cy, sizes[m]) and (
            rows[m, 0] == CIRCLE or crosses_shape(dx, dy, cx, cy, rows[m])
        ):
            return True
    return False


@kernel
def _sort_by_distance(state: Float, i: int, n_agents: int, reach: float, order: Double) -> int:
    """Lists the robots within reach of robot i as rows (distance, index), nearest first.

    A robot at NaN was missed and is not listed.
    """
    count = 0
    for j in range(n_agents):
        dx = float(state[N_COLUMNS * j + X]) - float(state[N_COLUMNS * i + X])
        dy = float(state[N_COLUMNS * j + Y]) - float(state[N_COLUMNS * i + Y])
        distance = math.sqrt(dx * dx + dy * dy)
        if j == i or not distance <= reach:
            continue
        slot = count
        while slot > 0 and order[slot - 1, 0] > distance:
            order[slot, 0] = order[slot - 1, 0]
            order[slot, 1] = order[slot - 1, 1]
            slot -= 1
        order[slot, 0] = distance
        order[slot, 1] = j
        count += 1
    return count


@kernel
def _write_slot(o: Float, state: Float, i: int, j: int, distance: float, span: float) -> None:
    at = N_COLUMNS * i
    dx = float(state[N_COLUMNS * j + X]) - float(state[at + X])
    dy = float(state[N_COLUMNS * j + Y]) - float(state[at + Y])
    ux, uy = float(state[at + UX]), float(state[at + UY])
    scale = 1.0 / max(distance, 1e-9)
    o[0] = distance / span
    o[1] = (ux * dx + uy * dy) * scale
    o[2] = (ux * dy - uy * dx) * scale
    o[3] = 1.0


@kernel
def observe_bearings(
    packed: Int,  # `Scene`, of an `ArgumentBlock`
    states: Float,  # [E, S] true ones, which decide who is hidden
    layouts: Float,  # [E, M, 8] true obstacles
    measured: Float,  # [E, S] states as measured; a robot that was missed is at NaN
    first_robot: int,  # that observes
    end_robot: int,  # one past the last
    active: Bool,  # copies to observe, [E]; rows of the others are not written
    out: Float,  # [E, N, F] written
) -> None:
    """Writes the `bearing` observation of some robots in every active copy."""
    scene = unpack(packed, SCENE)
    n_agents, radii, bodies, span = scene.n_agents, scene.radii, scene.bodies, scene.span
    n_rows = layouts.shape[1] + bodies.shape[0]
    rows, sizes, order = np.empty((n_rows, 8)), np.empty(n_rows), np.empty((n_agents, 2))
    for b in range(states.shape[0]):
        if not active[b]:
            continue
        state, known = states[b], measured[b]
        gather(state, layouts[b], n_agents, bodies, rows, sizes)
        for i in range(first_robot, end_robot):
            o = out[b, i]
            write_polar(o, known, i, scene.diagonal)
            o[N_POLAR : N_POLAR + _SLOT_WIDTH * scene.n_parts] = 0.0
            slot, reach = 0, min(scene.ranges[i], span)
            for nth in range(_sort_by_distance(known, i, n_agents, reach, order)):
                j = int(order[nth, 1])
                if slot < scene.n_parts and not _hidden(state, i, j, radii, rows, sizes):
                    first = N_POLAR + _SLOT_WIDTH * slot
                    _write_slot(o[first:], known, i, j, order[nth, 0], span)
                    slot += 1
