"""Mirror images of trained actors: the same skill with the opposite conventions.

A world whose layouts are drawn without a preferred side looks the same in a mirror. So the mirror
image of an actor is worth exactly as much as the actor, and where the one passes on the right, the
other passes on the left.
"""

import numpy as np

from swarmdata.behavior_policies.actor import Actor
from swarmdata.errors import CheckpointError


def mirrored(actor: Actor) -> Actor:
    """Returns the actor that does in a world mirrored at its x axis what `actor` does in the world.

    Weights change their signs only, so it stays exact.

    Args:
        actor: with a frame, whose vectors say which inputs are y components.

    Raises:
        CheckpointError: it has no frame.
    """
    if actor.frame is None:
        raise CheckpointError("only an actor with a frame can be mirrored: it knows its vectors.")
    size = len(actor.mean) - actor.frame.n_added
    sides = [*(first + 1 for first in actor.frame.vectors), size + 1]  # the last: y of the frame
    weight, bias = actor.layers[0]
    inputs = np.ones(len(weight))
    inputs[sides] = -1.0
    outputs = np.ones(len(actor.layers[-1][1]))
    outputs[1] = -1.0  # the command's y
    layers = list(actor.layers)
    layers[0] = (weight * inputs[:, None], bias)
    layers[-1] = (layers[-1][0] * outputs, layers[-1][1] * outputs)  # may be the same layer
    return actor._replace(mean=actor.mean * inputs[: len(actor.mean)], layers=tuple(layers))
