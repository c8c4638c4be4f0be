"""Stacked networks against plain torch modules."""

import pytest
import torch
from torch import nn

from swarmdata.errors import CheckpointError
from swarmdata.learn.networks.perceptrons import MLPShape, StackedMLP, initialize

SHAPE = MLPShape(inputs=5, hidden=(16, 8), outputs=2, layer_norm=True)


def made(shape: MLPShape, seeds: list[int], per_seed: int = 1) -> StackedMLP:
    network = StackedMLP(shape, per_seed * len(seeds), "cpu")
    initialize(network, seeds, stream=0)
    return network


def as_module(network: StackedMLP, row: int) -> nn.Sequential:
    """The same network out of torch's own layers."""
    modules: list[nn.Module] = []
    layers = network.extract(row, torch.float32)
    for layer in layers:
        linear = nn.Linear(layer.weight.shape[1], layer.weight.shape[2])
        linear.weight.data = layer.weight[0].T.clone()
        linear.bias.data = layer.bias[0, 0].clone()
        modules.append(linear)
        if layer.scale is not None and layer.shift is not None:
            norm = nn.LayerNorm(layer.scale.shape[-1])
            norm.weight.data, norm.bias.data = layer.scale[0, 0], layer.shift[0, 0]
            modules.append(norm)
        if layer is not layers[-1]:
            modules.append(nn.ReLU())
    return nn.Sequential(*modules)


@pytest.mark.parametrize("outputs", [1, 2])
@pytest.mark.parametrize("layer_norm", [False, True])
def test_outputs_and_gradients_equal_those_of_torch_modules(outputs: int, layer_norm: bool) -> None:
    network = made(MLPShape(5, (16, 8), outputs, layer_norm), [1, 2])
    x = torch.randn(2, 7, 5)
    network.backward(network(x).square().sum())
    for row in range(2):
        module = as_module(network, row)
        y = module(x[row])
        torch.testing.assert_close(network(x)[row], y)
        torch.autograd.backward(y.square().sum())
        gradients = torch.cat([
            (p.grad.T if p.ndim == 2 else p.grad).flatten()
            for p in module.parameters() if p.grad is not None
        ])  # fmt: skip
        assert gradients.abs().sum() > 0
        torch.testing.assert_close(network.gradient[row], gradients)


def test_uniform_initialization_has_torchs_bounds() -> None:
    network = made(MLPShape(25, (400,), 100), [3])
    first, second = network.extract(0, torch.float32)
    for layer, bound in ((first, 0.2), (second, 0.05)):
        for tensor in (layer.weight, layer.bias):
            assert 0.9 * bound < tensor.abs().max() <= bound


def test_orthogonal_initialization_has_its_gains() -> None:
    network = StackedMLP(MLPShape(16, (8,), 4), 1, "cpu")
    initialize(network, [0], 0, method="orthogonal", head_gain=0.01)
    first, head = network.extract(0, torch.float64)
    torch.testing.assert_close(
        first.weight[0].T @ first.weight[0], 2 * torch.eye(8).double(), atol=1e-5, rtol=0
    )
    torch.testing.assert_close(
        head.weight[0].T @ head.weight[0], 1e-4 * torch.eye(4).double(), atol=1e-9, rtol=0
    )
    assert first.bias.abs().sum() == 0


def test_frozen_weights_get_no_gradient_and_inputs_do() -> None:
    network = made(SHAPE, [1, 2])
    x = torch.randn(1, 3, 5, requires_grad=True)
    out = network.frozen(x, every=2)
    torch.testing.assert_close(out, network(x.expand(2, -1, -1))[:1])
    torch.autograd.backward(out.sum())
    assert x.grad is not None
    assert x.grad.abs().sum() > 0
    assert all(weight.grad is None for weight in network.layers[0] if weight is not None)


def test_parameters_of_other_networks_are_refused() -> None:
    with pytest.raises(CheckpointError, match=r"expected \(2, "):
        made(SHAPE, [1, 2]).load(made(SHAPE, [1]).flat)


def test_networks_that_do_not_divide_among_seeds_are_refused() -> None:
    with pytest.raises(ValueError, match="do not divide"):
        initialize(StackedMLP(SHAPE, 3, "cpu"), [1, 2], 0)
