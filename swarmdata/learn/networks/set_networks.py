"""Networks of many seeds over the sets in an observation: neighbors, obstacles, messages, goals.

Deep sets (Zaheer et al. 2017, theorem 2), with the robot's own features o beside each set X_k:

    e_k = max over x in X_k of relu(phi_k(o, x)); 0 if X_k is empty
    f(o, X_1, ..., X_n) = rho(o, e_1, ..., e_n)

The pool is a maximum (Qi et al., "PointNet", 2017, eq. 1): a mean over more neighbors than in
training hides the nearest one. No parameter knows the number of robots or of slots.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain

import torch
from torch import Tensor

from swarmdata.learn.networks.perceptrons import (
    Layer,
    MLPShape,
    StackedLayers,
    mlp,
    mlp_of_branches,
)
from swarmdata.perception.feature_slots import SlotKind, Slots


@dataclass(frozen=True, slots=True)
class SetShape:
    """Sizes of a network over sets: phi of each kind of slots, then rho.

    phi has the first hidden layer's size inside and the last one's as its output; rho all hidden
    ones.
    """

    slots: Slots
    hidden: tuple[int, ...]
    outputs: int

    @property
    def perceptrons(self) -> tuple[MLPShape, ...]:
        """The shapes of phi, one for each kind of slots, and of rho."""
        n_own, width = len(self.slots.own), self.hidden[-1]
        phi = (
            MLPShape(n_own + len(kind.fields), self.hidden[:1], width) for kind in self.slots.kinds
        )
        return *phi, MLPShape(n_own + width * len(self.slots.kinds), self.hidden, self.outputs)

    def layers(self) -> Iterator[tuple[int, int, bool]]:
        return chain.from_iterable(part.layers() for part in self.perceptrons)


class StackedSets(StackedLayers):
    """R independent networks over sets, trained and evaluated together."""

    shape: SetShape

    def __call__(self, inputs: Tensor) -> Tensor:
        """Returns the outputs, [R, B, outputs], of inputs [R, B, O]; masks are 0 or 1."""
        return over_sets(self.shape, self.layers, inputs)


def over_sets(shape: SetShape, layers: Sequence[Layer], inputs: Tensor) -> Tensor:
    """Returns the outputs, [R, B, outputs], of R networks: layers of all phi, then of rho.

    The shape's slots may be more or fewer than those of the training. `inputs` are observations,
    normalized except for their masks, [R, B, O].
    """
    own = inputs[..., list(shape.slots.own_columns)]
    n_phi = len(shape.hidden[:1]) + 1  # layers of one phi
    pools = [
        _pool(layers[k * n_phi : (k + 1) * n_phi], kind, own, inputs)
        for k, kind in enumerate(shape.slots.kinds)
    ]
    return mlp(layers[len(pools) * n_phi :], torch.cat([own, *pools], -1))


def _pool(layers: Sequence[Layer], kind: SlotKind, own: Tensor, inputs: Tensor) -> Tensor:
    """Returns e_k, [R, B, W]."""
    if not kind.n_slots:
        return own.new_zeros(*own.shape[:-1], layers[-1].weight.shape[-1])
    columns = [column for slot in kind.columns for column in slot]
    slots = inputs[..., columns].view(*own.shape[:-1], kind.n_slots, -1)  # [R, B, M, F]
    encoded = mlp_of_branches(layers, own, slots).relu()
    if kind.masks:
        filled = inputs[..., list(kind.masks)] != 0
        encoded = encoded.masked_fill(~filled[..., None], 0.0)
    return encoded.amax(2)
