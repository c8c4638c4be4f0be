"""The bodies of each episode: those of the spec, with what the episode has drawn instead."""

import math
from collections.abc import Sequence

import numpy as np

from swarmdata.envs.physics.dynamics import (
    ACCELERATION,
    FRICTION,
    GRIP,
    MASS,
    SPEED,
    TURN_RATE,
    UNICYCLE,
    limits_of,
)
from swarmdata.numerics.episode_draws import draw, drawn_values
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.randomization import PAYLOAD_RANGES
from swarmdata.specs.rules import Payload
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Double, Seeds

COLUMNS = {
    "max_speed": SPEED,
    "max_turn_rate": TURN_RATE,
    "mass": MASS,
    "friction": FRICTION,
    "wheel_grip": GRIP,
}
"""Columns of the limits that are fields of robots; accelerations follow from three of them."""

PAYLOAD_MASS, MOMENT, SLIDE_FRICTION, TURN_FRICTION, IS_ELLIPSOID = range(5)
"""Columns of payloads: kg, kg m^2, the most (N, N m) with which the floor holds them, and whether
these are the half axes of an ellipsoid."""

N_PAYLOAD = 5  # number of these columns

AT_REST = 1e-3  # m/s, of a payload, below which both limits hold in full


def episode_limits(spec: TaskSpec, seeds: Seeds) -> Double:
    """Limits and bodies of the robots of the episodes `seeds` [E], [E, N, 9]."""
    limits = np.tile(limits_of(spec), (len(seeds), 1, 1))
    drawn = drawn_values(spec, seeds)
    for name in COLUMNS.keys() & drawn.keys():
        limits[..., COLUMNS[name]] = drawn[name]
    nominal = np.array([robot.max_acceleration for robot in spec.robots])
    driven = drawn.get("max_acceleration", nominal) / limits[..., MASS]
    gripped = np.minimum(driven, limits[..., GRIP])
    limits[..., ACCELERATION] = np.where(limits[..., UNICYCLE] == 1.0, gripped, driven)
    return limits


def payload_rows(payloads: Sequence[Payload]) -> Double:
    """Returns what payloads weigh and how the floor holds them, [K, 5]."""
    rows = [_payload_row(each) for each in payloads]
    return np.array(rows, dtype=np.float64).reshape(-1, N_PAYLOAD)


def episode_payloads(spec: TaskSpec, payloads: Sequence[Payload], seeds: Seeds) -> Double:
    """`payload_rows` of the K payloads of a spec in the episodes `seeds` [E], [E, K, 5]."""
    names = PAYLOAD_RANGES.keys() & spec.randomization.ranges.keys()
    drawn = {PAYLOAD_RANGES[name]: draw(spec, name, seeds)[:, 0].tolist() for name in names}
    rows = np.empty((len(seeds), len(payloads), N_PAYLOAD))
    for b in range(len(seeds)):
        changes = {field: values[b] for field, values in drawn.items()}
        rows[b] = payload_rows([each.model_copy(update=changes) for each in payloads])
    return rows


@kernel(inline="always")
def floor_grip(body: Double, load: Double) -> tuple[float, float]:
    """The most force (N) and torque (N m) with which the floor holds a sliding payload.

    The two limits of `load` [5] are the half axes of an ellipsoid of forces, whose normal is the
    direction of sliding (Goyal, Ruina & Papadopoulos 1991; Howe & Cutkosky 1996): what only moves
    straight is turned by any torque. `body`: columns `state_layout.BODY`.
    """
    force, torque = load[SLIDE_FRICTION], load[TURN_FRICTION]
    along, around = body[2] * body[2] + body[3] * body[3], body[6] * torque / force
    slow, around = AT_REST * AT_REST, around * around
    both = along + around + slow
    return force * math.sqrt((along + slow) / both), torque * math.sqrt((around + slow) / both)


def _payload_row(payload: Payload) -> tuple[float, float, float, float, bool]:
    """Moments of inertia by the formulas of Munk2D; torques as of a disc of equal area."""
    mass, friction = payload.mass, payload.friction
    length, width = 2 * payload.half_length, 2 * payload.half_width
    if payload.shape == "circle":
        moment = mass * (0.5 * payload.half_length**2)
        area = math.pi * payload.half_length**2
    else:
        moment, area = mass * (length * length + width * width) / 12.0, length * width
    torque = friction * 2 / 3 * math.sqrt(area / math.pi)
    return mass, moment, friction, torque, payload.friction_limit == "ellipsoid"
