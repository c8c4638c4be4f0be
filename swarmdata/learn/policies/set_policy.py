"""SetPolicy, the greedy policy of one seed over sets, for teams of any size."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from swarmdata.errors import SchemaError
from swarmdata.learn.networks.network_inputs import standardize
from swarmdata.learn.networks.perceptrons import Layer
from swarmdata.learn.networks.set_networks import SetShape, over_sets
from swarmdata.learn.policies.torch_policy import Memoryless
from swarmdata.perception.feature_slots import Slots, slots_of
from swarmdata.perception.frames import Frame, find_frame, in_world
from swarmdata.specs.features import Feature
from swarmdata.types import Float


@dataclass(frozen=True, slots=True, eq=False)
class SetPolicy(Memoryless):
    """An actor over sets that all robots share and that sees no robot numbers.

    It computes in float64 on the CPU and rounds once at the end, as `TorchPolicy` does.

    Attributes:
        layers: the actor's weights (`set_networks`), float64, R = 1.
        field_mean: subtracted from what is read, float64 [F], F as in `slots.fields`.
        field_std: what it is divided by, float64 [F].
        squash: whether the output passes through tanh; otherwise it is clipped to [-1, 1].
        slots: what the columns of an observation describe.
        hidden: sizes of the actor's hidden layers.
        frame: in which the actor sees and acts; None for the world's.
        anchor: of that frame, as `frames.find_frame` takes it.
    """

    layers: Sequence[Layer]
    field_mean: Tensor
    field_std: Tensor
    squash: bool
    slots: Slots
    hidden: tuple[int, ...]
    frame: Frame | None = None
    anchor: str = "world"
    uses_state: bool = False

    @torch.no_grad()
    def actions(self, observations: Float) -> Float:
        """Returns the actors' actions, float32 [E, N, A], for observations [E, N, O].

        Raises:
            SchemaError: the observations have another number of features.
        """
        framed = observations if self.frame is None else self.frame.inputs(observations)
        if framed.shape[-1] != self.slots.n_columns:
            raise SchemaError(
                f"policy got observations {framed.shape}, expected {self.slots.n_columns} features "
                "of any number of robots. To act with other numbers of slots, use the policy that "
                "`SetPolicy.fitted` returns for them."
            )
        moments = self.slots.normalizing(self.field_mean.numpy(), self.field_std.numpy())
        mean, std = (torch.from_numpy(each) for each in moments)
        features = standardize(torch.from_numpy(framed.astype(np.float64)), mean, std)
        shape = SetShape(self.slots, self.hidden, self.layers[-1].weight.shape[-1])
        outputs = over_sets(shape, self.layers, features.flatten(0, 1)[None])
        actions = (outputs.tanh() if self.squash else outputs.clamp(-1, 1)).numpy()
        local = actions.reshape(*observations.shape[:2], -1)
        return in_world(self.frame, observations, local).astype(np.float32)

    def fitted(self, features: Sequence[Feature]) -> "SetPolicy":
        """Returns the same policy for observations with other numbers of slots.

        Args:
            features: of one robot's observation.

        Raises:
            PolicyFitError: the own features, the kinds of slots or their fields differ.
            SpecError: the vector that the frame turns with is not observed.
        """
        frame = find_frame(features, self.anchor)
        slots = slots_of(tuple(feature.name for feature in features), frame)
        return replace(self, frame=frame, slots=slots.in_order_of(self.slots))
