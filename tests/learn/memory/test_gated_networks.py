"""Gated units equal torch's, forget where told to, and stack."""

from typing import Any

import torch

from swarmdata.learn.memory.gated_networks import GatedShape, StackedGates, memories
from swarmdata.learn.networks.perceptrons import initialize

F, M, T, B = 5, 4, 6, 3


def made() -> StackedGates:
    network = StackedGates(GatedShape(F, M), 2, "cpu")
    initialize(network, range(2), 0)
    return network


def torch_unit(network: StackedGates, row: int) -> Any:
    """The unit of one row as torch writes it: outputs first, r, z, n."""
    unit: Any = torch.nn.GRU(F, M)
    of_inputs, of_memory = network.extract(row, torch.float32)[:2]
    with torch.no_grad():
        unit.weight_ih_l0.copy_(of_inputs.weight[0].T)
        unit.bias_ih_l0.copy_(of_inputs.bias[0, 0])
        unit.weight_hh_l0.copy_(of_memory.weight[0].T)
        unit.bias_hh_l0.copy_(of_memory.bias[0, 0])
    return unit


def test_memories_and_gradients_are_those_of_torch() -> None:
    network = made()
    inputs = torch.randn(2, T, B, F, generator=torch.Generator().manual_seed(0))
    starts = torch.zeros(2, T, B, dtype=torch.bool)
    starts[:, 0] = True
    found = memories(network.layers, inputs, starts)
    network.backward(found.square().sum())
    of_inputs, of_memory = network._gradients
    for row in range(2):
        unit = torch_unit(network, row)
        expected, _ = unit(inputs[row])
        torch.testing.assert_close(found[row], expected, rtol=1e-5, atol=1e-6)
        expected.square().sum().backward()
        pairs = (
            (of_inputs.weight[row].T, unit.weight_ih_l0.grad),
            (of_inputs.bias[row, 0], unit.bias_ih_l0.grad),
            (of_memory.weight[row].T, unit.weight_hh_l0.grad),
            (of_memory.bias[row, 0], unit.bias_hh_l0.grad),
        )
        for ours, theirs in pairs:
            torch.testing.assert_close(ours, theirs, rtol=1e-4, atol=1e-5)


def test_a_start_forgets_what_was_before() -> None:
    network, inputs = made(), torch.randn(2, T, B, F)
    starts = torch.zeros(2, T, B, dtype=torch.bool)
    starts[:, 3, 1] = True
    changed = inputs.clone()
    changed[:, :3] += 1.0
    one, other = memories(network.layers, inputs, starts), memories(network.layers, changed, starts)
    assert torch.equal(one[:, 3:, 1], other[:, 3:, 1])
    assert not torch.isclose(one[:, 3:, [0, 2]], other[:, 3:, [0, 2]]).all(-1).any()
