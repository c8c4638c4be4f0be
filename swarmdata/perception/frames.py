"""Frames in which policies observe and act: the world's, or each robot's own, turned to an anchor.

The arithmetic is elementwise float64 `+ - * /` and `sqrt`: its bits are the same everywhere.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from swarmdata.errors import SchemaError, SpecError
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.features import Feature
from swarmdata.specs.task_spec import Robot
from swarmdata.types import Batch, Bool, Double, Float, Int

HEARING_RANGE = 1.25
"""Distance (m) between the centres of robots at and beyond which the nearness of a sender is 0."""

NOT_SENT = -1  # stands for the index of a velocity that messages do not have
NO_HEADING = -1  # stands for the index of the heading in teams without unicycles

HEADING = "own.heading"
"""The observed direction of a unicycle; (1, 0) for the other robots of a mixed team."""

TARGET = "own.goal_dx"  # the observed vector to a robot's own target, the anchor `target`


@dataclass(frozen=True)
class Frame:
    """Turns observations and actions about the direction of one observed vector, the anchor.

    It adds what a small network does not form: closing speeds, and nearness of who is only heard.
    """

    anchor: int  # index of the anchor's x component in an observation; its y component follows
    vectors: tuple[int, ...]
    """Indices of the x components of all planar vectors; their y components follow."""
    closing: tuple[tuple[int, int], ...]
    """Pairs of such indices: the direction to a near object, and the velocity relative to it; the
    frame adds their scalar product, the closing speed."""
    heard: tuple[tuple[int, int, int], ...] = ()
    """For each slot of messages, the indices of the sender's position, of the robot's own velocity
    and of the sender's, -1 if that is not sent. The frame adds the direction to the sender times
    its nearness, 1 - distance / `HEARING_RANGE`, and the scalar product of that vector and the own
    velocity minus the sender's; 0 beyond that distance and for senders that were never heard."""
    heading: int = NO_HEADING
    """Index of the x component of the own heading, the anchor of unicycles; their commands do not
    turn."""
    holonomic: tuple[int, ...] = ()
    """The robots of a mixed team that are not unicycles."""

    n_features: ClassVar[int | None] = None
    """Of the observations that `find_frame` found it in; None: not known, of a frame in a file."""

    @property
    def n_added(self) -> int:
        return 2 + len(self.closing) + 3 * len(self.heard)

    def names(self, names: Sequence[str]) -> tuple[str, ...]:
        """Returns the names of what `inputs` returns, such as `neighbor_0.closing`, of [O]."""
        near = (names[k].rpartition(".")[0] for k, _ in self.closing)
        senders = (names[k].rpartition(".")[0] for k, *_ in self.heard)
        return (
            *names, "frame.x", "frame.y", *(f"{slot}.closing" for slot in near),
            *(f"{s}.{name}" for s in senders for name in ("near_x", "near_y", "closing")),
        )  # fmt: skip

    def anchor_of(self, names: Sequence[str]) -> str:
        """Returns the anchor as `find_frame` takes it, given the names of the features, [O]."""
        name = names[self.anchor]
        return "target" if name == TARGET else name.removesuffix("_x")

    def fits(self, n_features: int) -> bool:
        """Whether all vectors of this frame are in observations with `n_features` features."""
        return min(self._columns) >= 0 and max(self._columns) + 1 < n_features

    @cached_property
    def _columns(self) -> frozenset[int]:
        """The x components that it reads; their y components follow."""
        first = {self.anchor, *self.vectors, *(k for pair in self.closing for k in pair)}
        first |= set() if self.heading == NO_HEADING else {self.heading}
        for position, own, other in self.heard:
            first |= {position, own} if other == NOT_SENT else {position, own, other}
        return frozenset(first)

    def check(self, observations: Float) -> None:
        """Refuses observations of others than those that it turns, [..., O]: SchemaError."""
        size = observations.shape[-1]
        if not (self.fits(size) if self.n_features is None else size == self.n_features):
            expected = self.n_features or f"at least {max(self._columns) + 2}"
            raise SchemaError(
                f"the frame turns observations of {expected} features, got {size}. Pass "
                "swarmdata.frame_of(spec) of the spec that they are of, and turn them once"
            )

    def turns(self, n_robots: int) -> Bool:
        """Whether each robot turns to the anchor, and its commands with it, [N]."""
        turns = np.full(n_robots, self.heading == NO_HEADING)
        turns[list(self.holonomic)] = True
        return turns

    def directions(self, observations: Float) -> tuple[Double, Double]:
        """Returns the frame's x axis, two arrays [..., N]; the world's where the anchor is 0."""
        n = observations.shape[-2]
        first = np.where(self.turns(n), self.anchor, self.heading)
        x, y = (observations[..., np.arange(n), first + k].astype(np.float64) for k in (0, 1))
        length = np.sqrt(x * x + y * y)
        is_zero = length == 0.0
        length = np.where(is_zero, 1.0, length)
        return np.where(is_zero, 1.0, x / length), y / length

    def inputs(self, observations: Float) -> Float:
        """Returns the inputs of a policy, float32 [..., N, O + 2 + C + 3 H].

        These are the observations with their vectors turned, the frame's x axis in the world, the
        closing speeds, and nearness (x, y) and closing speed of senders.
        """
        self.check(observations)
        size = observations.shape[-1]
        out = np.empty((*observations.shape[:-1], size + self.n_added), np.float32)
        rows = np.ascontiguousarray(observations).reshape(-1, size)
        turns = self.turns(observations.shape[-2])
        axes = turns, self.anchor, self.heading
        _turn(rows, *axes, *self._indices, out.reshape(-1, size + self.n_added))
        return out

    @cached_property
    def _indices(self) -> tuple[Int, Int, Int]:
        """`vectors`, `closing` and `heard` for the kernel: [V], [C, 2], [H, 3]."""
        return (
            np.array(self.vectors, np.int64),
            np.array(self.closing, np.int64).reshape(-1, 2),
            np.array(self.heard, np.int64).reshape(-1, 3),
        )

    def to_world(self, observations: Float, actions: Float | Double) -> Double:
        """Returns actions of this frame in the world's, [..., N, A]; columns 0 and 1 turn.

        Observations are in the world's frame, [..., N, O].
        """
        return self._rotated(observations, actions, 1.0)

    def to_local(self, observations: Float, actions: Float | Double) -> Double:
        """Returns actions in this frame; the inverse of `to_world`."""
        return self._rotated(observations, actions, -1.0)

    def _rotated(self, observations: Float, actions: Float | Double, sign: float) -> Double:
        """Turns actions from this frame to the world's (sign 1), or back (sign -1)."""
        out, turns = actions.astype(np.float64), self.turns(observations.shape[-2])
        ux, uy = self.directions(observations)
        x, y, uy = out[..., 0].copy(), out[..., 1].copy(), sign * uy
        out[..., 0] = np.where(turns, ux * x - uy * y, x)
        out[..., 1] = np.where(turns, uy * x + ux * y, y)
        return out

    def turned(self, batch: Batch) -> Batch:
        """Returns a batch as robots see and act in this frame: `inputs`, and `recorded` actions."""
        changes: dict[str, Float] = {}
        for before in ("", "next_"):
            seen = getattr(batch, f"{before}observations")
            taken = getattr(batch, f"{before}actions")
            if seen is not None:
                changes[f"{before}observations"] = self.inputs(seen)
            if taken is not None:
                changes[f"{before}actions"] = self.recorded(seen, taken)
        return replace(batch, **changes)

    def recorded(self, observations: Float, actions: Float) -> Float:
        """Returns recorded actions in this frame, float32 [..., N, A], within [-1, 1].

        Worlds clip a vector to a norm of 1 (`envs.physics.dynamics`), and here it is clipped before
        it is turned. Observations, [..., N, O], and actions given are in the world's frame.
        """
        x, y = actions[..., 0].astype(np.float64), actions[..., 1].astype(np.float64)
        turns = self.turns(actions.shape[-2])
        norm = np.where(turns, np.maximum(np.sqrt(x * x + y * y), 1.0), 1.0)
        clipped = actions.astype(np.float64)
        clipped[..., 0], clipped[..., 1] = x / norm, y / norm
        return self.to_local(observations, clipped).clip(-1, 1).astype(np.float32)


def current_fields(fields: Mapping[str, Any]) -> dict[str, Any]:
    """Returns the fields of a `Frame`, given those in a file, which may be an older one's."""
    found = dict(fields)
    if not found.pop("turns_commands", True):  # the anchor is the heading of unicycles
        found["heading"] = found["anchor"]
    return found


@kernel
def _direction(row: Float, first: int) -> tuple[float, float]:
    """Returns the direction of the vector at column `first`; (1, 0) if its length is 0."""
    x, y = np.float64(row[first]), np.float64(row[first + 1])
    length = np.sqrt(x * x + y * y)
    if length == 0.0:
        return 1.0, 0.0
    return x / length, y / length


@kernel
def _turn(
    rows: Float,  # [M, O] observations, robot after robot
    turns: Bool,  # [N]
    anchor: int,
    heading: int,
    vectors: Int,  # [V]
    closing: Int,  # [C, 2]
    heard: Int,  # [H, 3]
    out: Float,  # [M, O + 2 + C + 3 H] written
) -> None:
    """Writes `Frame.inputs`."""
    size = rows.shape[1]
    for m in range(len(rows)):
        row, inputs = rows[m], out[m]
        ux, uy = _direction(row, anchor if turns[m % len(turns)] else heading)
        for k in range(size):
            inputs[k] = row[k]
        for k in vectors:
            x, y = np.float64(row[k]), np.float64(row[k + 1])
            inputs[k], inputs[k + 1] = ux * x + uy * y, ux * y - uy * x
        inputs[size], inputs[size + 1] = ux, uy
        for c in range(len(closing)):
            near, speed = closing[c]
            product = np.float64(row[near]) * np.float64(row[speed])
            inputs[size + 2 + c] = product + np.float64(row[near + 1]) * np.float64(row[speed + 1])
        at = size + 2 + len(closing)
        for h in range(len(heard)):
            x, y, speed = _approach(row, heard[h])
            inputs[at], inputs[at + 1], inputs[at + 2] = ux * x + uy * y, ux * y - uy * x, speed
            at += 3


@kernel
def _approach(row: Float, heard: Int) -> tuple[float, float, float]:
    """Returns nearness times direction of a sender, x and y, and the closing speed."""
    position, own, other = heard
    x, y = np.float64(row[position]), np.float64(row[position + 1])
    distance = np.sqrt(x * x + y * y)
    if distance == 0.0 or distance >= HEARING_RANGE:
        return 0.0, 0.0, 0.0
    scale = (1.0 - distance / HEARING_RANGE) / distance
    x, y = x * scale, y * scale
    vx, vy = np.float64(row[own]), np.float64(row[own + 1])
    if other != NOT_SENT:
        vx, vy = vx - np.float64(row[other]), vy - np.float64(row[other + 1])
    return x, y, x * vx + y * vy


def in_world(frame: Frame | None, observations: Float, actions: Double) -> Double:
    """Returns a policy's actions of a frame in the world's, within [-1, 1], [E, N, A].

    The norm is clipped to 1 before the components, so that a turned command keeps its direction.
    Observations are in the world's frame, [E, N, O]; `frame` is None for the world's.
    """
    if frame is None:
        return actions
    frame.check(observations)
    turned = np.array(actions, np.float64, order="C")
    rows = np.ascontiguousarray(observations).reshape(-1, observations.shape[-1])
    turns = frame.turns(observations.shape[-2])
    _turn_back(rows, turns, frame.anchor, turned.reshape(-1, actions.shape[-1]))
    return turned


@kernel
def _turn_back(rows: Float, turns: Bool, anchor: int, actions: Double) -> None:
    """Turns actions [M, A] by `in_world`, in place, given observations [M, O]; NaN stays NaN."""
    for m in range(len(rows)):
        if not turns[m % len(turns)]:
            continue
        ux, uy = _direction(rows[m], anchor)
        x = ux * actions[m, 0] - uy * actions[m, 1]
        y = uy * actions[m, 0] + ux * actions[m, 1]
        norm = np.sqrt(x * x + y * y)
        norm = max(norm, 1.0)
        actions[m, 0], actions[m, 1] = x / norm, y / norm
        for a in range(actions.shape[1]):
            if actions[m, a] > 1.0:
                actions[m, a] = 1.0
            elif actions[m, a] < -1.0:
                actions[m, a] = -1.0


def natural_anchor(features: Sequence[Feature], robots: Sequence[Robot] = ()) -> str:
    """Returns `target`, `own.heading` where all are unicycles, or `world` if it is not observed."""
    names = {feature.name for feature in features}
    if f"{HEADING}_x" in names and not (_holonomic(robots) and TARGET in names):
        return HEADING
    return "target" if TARGET in names else "world"


def _holonomic(robots: Sequence[Robot]) -> tuple[int, ...]:
    return tuple(i for i, robot in enumerate(robots) if robot.dynamics == "holonomic")


def find_frame(
    features: Sequence[Feature], anchor: str, robots: Sequence[Robot] = ()
) -> Frame | None:
    """Returns the frame of an anchor, None for the world's.

    Args:
        features: of an observation.
        anchor: the vector along the x axis: the name of an observed vector without its `_x`, such
            as `payload_goal`, or `target`, the robot's own; `own.heading` where some robots are
            unicycles, which turn to it in any case; `world` for no rotation; `auto` for the
            `natural_anchor`.
        robots: of the team; none: if a heading is observed, all are unicycles.

    Raises:
        SpecError: these observations have no such vector.
    """
    if anchor == "auto":
        anchor = natural_anchor(features, robots)
    if anchor == "world":
        return None
    has_unicycles = any(feature.name.startswith(HEADING) for feature in features)
    others = _holonomic(robots) if has_unicycles else ()
    if has_unicycles and not others and anchor != HEADING:
        raise SpecError(
            f"frame {anchor!r} turns commands as vectors, but all robots are unicycles. Use frame "
            f"'world' or {HEADING!r}."
        )
    name = TARGET if anchor == "target" else f"{anchor}_x"
    vectors = tuple(k for k, feature in enumerate(features) if feature.axis == "x")
    found = [k for k in vectors if features[k].name == name]
    if not found:
        known = sorted(
            features[k].name.removesuffix("_x") for k in vectors if features[k].name.endswith("_x")
        )
        raise SpecError(
            f"frame {anchor!r} needs the observed vector {name}, which robots do not observe here. "
            f"Set frame to 'auto' (here {natural_anchor(features, robots)!r}), 'world', 'target' "
            f"(where {TARGET} is observed) or one of {', '.join(known)}."
        )
    index = {feature.name: k for k, feature in enumerate(features)}
    heading = index.get(f"{HEADING}_x", NO_HEADING)
    frame = Frame(found[0], vectors, _closing(index), _heard(index), heading, others)
    object.__setattr__(frame, "n_features", len(features))  # no field: networks have it in files
    return frame


def _closing(index: Mapping[str, int]) -> tuple[tuple[int, int], ...]:
    """Indices of near direction and relative velocity, for each slot of robots and obstacles."""
    pairs = []
    for name, k in index.items():
        slot, _, field = name.rpartition(".")
        if field == "near_x":
            speed = index.get(f"{slot}.dvx", index.get("own.vx"))  # obstacles stand still
            pairs += [(k, speed)] if speed is not None else []
    return tuple(pairs)


def _heard(index: Mapping[str, int]) -> tuple[tuple[int, int, int], ...]:
    """Indices of sender's position, own velocity, sender's velocity, for each slot of messages."""
    own = index.get("own.vx")
    slots = [name.partition(".")[0] for name in index if name.endswith(".position_x")]
    return tuple(
        (index[f"{slot}.position_x"], own, index.get(f"{slot}.velocity_x", NOT_SENT))
        for slot in slots
        if own is not None and slot.startswith("message_")
    )
