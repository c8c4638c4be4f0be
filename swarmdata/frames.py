"""Frames in which policies see and act: the world's, or each robot's own, turned to an anchor.

A task without preferred directions looks the same when it is turned. A policy that sees every
vector relative to where its robot has to go need not learn the same driving for every direction.
On `coop_nav`, clones of the scripted controller finished 57 % of their episodes without a contact
in the frame of the target, and 36 % in the world's.

The arithmetic is elementwise float64 `+ - * /` and `sqrt`: its bits are the same everywhere.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from swarmdata.errors import SpecError
from swarmdata.features import Feature
from swarmdata.types import Double, Float


@dataclass(frozen=True)
class Frame:
    """Turns observations and actions about the direction of one observed vector, the anchor.

    Attributes:
        anchor: index of the anchor's x component in an observation; its y component follows.
        vectors: indices of the x components of all planar vectors; their y components follow.
    """

    anchor: int
    vectors: tuple[int, ...]

    def directions(self, observations: Float) -> tuple[Double, Double]:
        """Returns the unit vectors of the frame's x axis, two arrays [..., N].

        Where the anchor has no length, the frame is the world's.
        """
        x, y = (observations[..., self.anchor + k].astype(np.float64) for k in (0, 1))
        length = np.sqrt(x * x + y * y)
        still = length == 0.0
        length = np.where(still, 1.0, length)
        return np.where(still, 1.0, x / length), y / length

    def seen(self, observations: Float) -> Float:
        """Returns observations in this frame, then the frame's x axis, float32 [..., N, O + 2]."""
        ux, uy = (u[..., None] for u in self.directions(observations))
        first = np.array(self.vectors)
        x, y = observations[..., first].astype(np.float64), observations[..., first + 1]
        out = np.empty((*observations.shape[:-1], observations.shape[-1] + 2), np.float32)
        out[..., :-2] = observations
        out[..., first], out[..., first + 1] = ux * x + uy * y, ux * y - uy * x
        out[..., -2:-1], out[..., -1:] = ux, uy
        return out

    def to_world(self, observations: Float, actions: Float | Double) -> Double:
        """Returns actions of this frame in the world's, [..., N, A]; the first two are turned.

        Args:
            observations: in the world's frame, [..., N, O].
            actions: in this frame, [..., N, A].
        """
        ux, uy = self.directions(observations)
        out = actions.astype(np.float64)
        x, y = actions[..., 0].astype(np.float64), actions[..., 1].astype(np.float64)
        out[..., 0], out[..., 1] = ux * x - uy * y, uy * x + ux * y
        return out

    def to_local(self, observations: Float, actions: Float | Double) -> Double:
        """Returns actions of the world's frame in this one; the inverse of `to_world`."""
        ux, uy = self.directions(observations)
        out = actions.astype(np.float64)
        x, y = actions[..., 0].astype(np.float64), actions[..., 1].astype(np.float64)
        out[..., 0], out[..., 1] = ux * x + uy * y, ux * y - uy * x
        return out


def find_frame(features: Sequence[Feature], anchor: str) -> Frame | None:
    """Returns the frame of an anchor, None for the world's.

    Args:
        features: of an observation.
        anchor: what the x axis points to: the name of an observed vector without its `_x`, such as
            `payload_goal`, or `target`, the robot's own; `world` for no turning at all.

    Raises:
        SpecError: these observations have no such vector.
    """
    if anchor == "world":
        return None
    name = "own.goal_dx" if anchor == "target" else f"{anchor}_x"
    vectors = tuple(k for k, feature in enumerate(features) if feature.axis == "x")
    found = [k for k in vectors if features[k].name == name]
    if not found:
        known = sorted(
            features[k].name.removesuffix("_x") for k in vectors if features[k].name.endswith("_x")
        )
        raise SpecError(
            f"frame {anchor!r} needs the observed vector {name}; expected 'world', 'target' (where "
            f"own.goal_dx is observed) or one of {', '.join(known)}."
        )
    return Frame(found[0], vectors)
