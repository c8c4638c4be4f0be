"""Networks are made fit for exact inference without changing what they compute."""

from itertools import pairwise

import numpy as np

from swarmdata.behavior_policies.exact_actor import MAX_WEIGHT, Layer
from swarmdata.online_algos.runs.export_policy import scale_hidden_units
from swarmdata.types import Double


def outputs(layers: list[Layer], inputs: Double) -> Double:
    x = inputs
    for weight, bias in layers[:-1]:
        x = np.maximum(x @ weight + bias, 0.0)
    weight, bias = layers[-1]
    return x @ weight + bias


def network(rng: np.random.Generator) -> list[Layer]:
    sizes = (5, 8, 6, 2)
    return [
        (rng.normal(size=(n_in, n_out)), rng.normal(size=n_out)) for n_in, n_out in pairwise(sizes)
    ]


def test_large_weights_and_biases_of_hidden_units_move_on_to_the_next_layer() -> None:
    rng = np.random.default_rng(0)
    layers = network(rng)
    layers[0][0][3, 4], layers[1][0][2, 1], layers[1][1][5] = 40.0, -8.9, 17.0
    scaled = scale_hidden_units(layers)
    inputs = rng.normal(size=(50, 5))

    np.testing.assert_allclose(outputs(scaled, inputs), outputs(layers, inputs), rtol=1e-12)
    assert max(np.abs(each).max() for layer in scaled[:-1] for each in layer) <= MAX_WEIGHT
    assert layers[0][0][3, 4] == 40.0  # the layers themselves stay


def test_small_weights_stay_as_they_are() -> None:
    layers = network(np.random.default_rng(1))
    for old, new in zip(layers, scale_hidden_units(layers), strict=True):
        np.testing.assert_array_equal(old[0], new[0])
        np.testing.assert_array_equal(old[1], new[1])
