"""Messages: their columns, their quantiser, and their features in a receiver's observation."""

import math

import numpy as np

from swarmdata.runtime.kernels import kernel
from swarmdata.specs.features import Feature, leading_to_places, numbered, vector
from swarmdata.specs.sensing_models import Broadcast
from swarmdata.specs.state_layout import N_COLUMNS, TX, TY, UX, UY, VX, VY, X, Y
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Bool, Counts, Double, Float, Int

NEXT = N_COLUMNS
"""Added to a column of the sender: the same column of the next robot, of the first after the last.
"""

PAYLOAD_COLUMNS = {
    "pose": (X, Y, UX, UY),
    "pose_and_goal": (X, Y, UX, UY, TX, TY),
    "errand": (X, Y, UX, UY, NEXT + TX, NEXT + TY),
    "state": (X, Y, VX, VY, UX, UY),
    "learned": (),
}
"""Columns that each payload carries, from the sender's first one on, two for each vector."""

POSITIONS = (X, Y, TX, TY, NEXT + TX, NEXT + TY)  # the columns that are positions in the world

_FROM_OWN = "the sender's position when it sent, minus the own now, both as measured"

VECTOR_FEATURES = {
    X: vector("position", "position", _FROM_OWN),
    VX: vector("velocity", "velocity", "the sender's velocity when it sent"),
    UX: vector("heading", "direction", "the sender's heading when it sent"),
    TX: leading_to_places(
        vector("target", "position", "its target when it sent, minus the own measured position")
    ),
    NEXT + TX: leading_to_places(
        vector(
            "errand",
            "position",
            "the own target when it was sent, minus the own measured position; 0 from senders that "
            "know that of another robot",
        )
    ),
}
"""Features of the vector that starts at a column."""

AGE_LIMIT = 20  # age (steps) at and above which the feature `age` is 1

TRAILER_FEATURES = (
    Feature("age", "flag", "", "steps since it was sent / 20, at most 1"),
    Feature("mask", "flag", "", "1 if anything was ever received from this sender"),
    Feature("sender", "flag", "", "index of the sender / (robots - 1)"),
)
"""The features after the message in a slot."""


def message_fields(model: Broadcast) -> tuple[Feature, ...]:
    """Returns the P features of one message in a receiver's observation."""
    if model.payload == "learned":
        return tuple(
            Feature(f"value_{c}", "flag", "", "value of a learned message")
            for c in range(model.message_size)
        )
    columns = PAYLOAD_COLUMNS[model.payload]
    return tuple(field for column in columns[::2] for field in VECTOR_FEATURES[column])


def slot_features(model: Broadcast, n_agents: int) -> tuple[Feature, ...]:
    """Returns the features of one robot's N - 1 slots, one for each other robot in agent order."""
    age, mask, sender = TRAILER_FEATURES
    if model.max_age is not None:
        what = f"1 if a message of this sender is at most {model.max_age} steps old"
        mask = mask._replace(meaning=what)
    return numbered("message", n_agents - 1, (*message_fields(model), age, mask, sender))


def quantizer(model: Broadcast, spec: TaskSpec) -> tuple[Double, Double]:
    """Returns lower ends [N, P] and cell widths [N, P] of each sender's uniform quantiser.

    The range of a position is the arena, of a velocity the sender's top speed both ways, of a
    direction or a learned value [-1, 1]. Without `bits` the width is 0: values are not quantised.
    """
    spans = np.array([_half_spans(model, speed, spec) for speed in spec.largest("max_speed")])
    n_cells = 0 if model.bits is None else 1 << model.bits
    return -spans, 2.0 * spans / n_cells if n_cells else np.zeros_like(spans)


def _half_spans(model: Broadcast, speed: float, spec: TaskSpec) -> list[float]:
    """Half the quantiser's range of each value, [P]."""
    width, height = spec.arena.width / 2, spec.arena.height / 2
    spans = {X: width, Y: height, TX: width, TY: height, VX: speed, VY: speed, UX: 1.0, UY: 1.0}
    if model.payload == "learned":
        return [1.0] * model.message_size
    return [spans[column % N_COLUMNS] for column in PAYLOAD_COLUMNS[model.payload]]


@kernel(inline="always")
def quantize(value: float, low: float, width: float, n_cells: int) -> float:
    """The middle of the cell that holds the value, or of the outermost one; cells begin at low."""
    cell = math.floor(min(max((value - low) / width, 0.0), n_cells - 1.0))
    return low + (cell + 0.5) * width


@kernel(inline="always")
def compose(
    known: Float,  # [E, >= 8 N] the robots' measurements of themselves, columns `ROBOT` first
    actions: Float,  # learned message of each robot, [E, N, P]; not read for other payloads
    e: int,  # the copy
    begins: bool,  # whether its episode has just begun; there is no action yet, so learned messages
    # are zero
    columns: Int,  # [P or 0] of the payload; empty for learned messages
    low: Double,  # [N, P] lower ends of the quantiser
    width: Double,  # [N, P] widths of its cells
    n_cells: int,  # cells of the quantiser, 0 for none
    sent: Float,  # written
) -> None:
    """Writes the messages of all robots of copy e, sent [E, N, P]."""
    is_learned, n_values = columns.shape[0] == 0, N_COLUMNS * sent.shape[1]
    for j in range(sent.shape[1]):
        for c in range(sent.shape[2]):
            if is_learned:
                value = 0.0 if begins else min(max(float(actions[e, j, c]), -1.0), 1.0)
            else:
                value = float(known[e, (N_COLUMNS * j + columns[c]) % n_values])
            if n_cells > 0 and not (is_learned and begins):
                value = quantize(value, low[j, c], width[j, c], n_cells)
            sent[e, j, c] = value


@kernel(inline="always")
def write_slots(
    known: Float,  # [E, >= 8 N] the robots' measurements of themselves, columns `ROBOT` first
    e: int,  # the copy
    held: Float,  # [E, N, N, P] newest message of each (receiver, sender)
    ages: Counts,  # [E, N, N] its age in steps, or NEVER_RECEIVED
    columns: Int,  # [P or 0] of the payload; empty for learned messages
    is_position: Bool,  # [P or 0] which of its columns are positions
    in_body_frame: bool,  # whether vectors are rotated into the receiver's body frame
    max_age: int,  # steps after which a message is forgotten, less than NEVER_RECEIVED
    out: Float,  # written
) -> None:
    """Writes the slots of every robot of copy e, out [E, N, (N-1) (P+3)]."""
    n, size = held.shape[2], held.shape[3]
    for i in range(n):
        o = 0
        for j in range(n):
            if j == i:
                continue
            if ages[e, i, j] > max_age:
                for c in range(size + 3):
                    out[e, i, o + c] = 0.0
            else:
                if columns.shape[0] == 0:
                    for c in range(size):
                        out[e, i, o + c] = held[e, i, j, c]
                else:
                    _write_vectors(
                        known, e, i, j, held, columns, is_position, in_body_frame, out, o
                    )
                out[e, i, o + size] = min(ages[e, i, j], AGE_LIMIT) / AGE_LIMIT
                out[e, i, o + size + 1] = 1.0
                out[e, i, o + size + 2] = j / (n - 1)
            o += size + 3


@kernel(inline="always")
def _write_vectors(
    known: Float,
    e: int,
    i: int,
    j: int,
    held: Float,
    columns: Int,
    is_position: Bool,
    in_body_frame: bool,
    out: Float,
    o: int,
) -> None:
    """Writes robot j's message into out[e, i, o:], relative to robot i; no other robot's errand."""
    is_next = (j + 1) % held.shape[2] == i
    first = N_COLUMNS * i
    ux, uy = float(known[e, first + UX]), float(known[e, first + UY])
    for c in range(0, held.shape[3], 2):
        if columns[c] >= NEXT and not is_next:
            out[e, i, o + c], out[e, i, o + c + 1] = 0.0, 0.0
            continue
        vx, vy = float(held[e, i, j, c]), float(held[e, i, j, c + 1])
        if is_position[c]:
            vx -= float(known[e, first + X])
            vy -= float(known[e, first + Y])
        if in_body_frame:
            vx, vy = vx * ux + vy * uy, vy * ux - vx * uy
        out[e, i, o + c] = vx
        out[e, i, o + c + 1] = vy
