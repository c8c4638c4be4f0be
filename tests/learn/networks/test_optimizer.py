"""The stacked Adam against torch's plain one, clipping, and the cosine."""

import sys

import pytest
import torch
from torch import Tensor

from swarmdata.learn.networks.optimizer import Descent, StackedAdam, clip_per_seed, cosine, linear
from swarmdata.learn.networks.perceptrons import MLPShape, StackedMLP, initialize, mlp, n_parameters

SHAPE = MLPShape(3, (8,), 2)


def network_of(seeds: list[int]) -> StackedMLP:
    network = StackedMLP(SHAPE, len(seeds), "cpu")
    initialize(network, seeds, 0)
    return network


def loss_of(outputs: Tensor) -> Tensor:
    return (outputs - 1).square().mean((1, 2))


def test_it_equals_plain_adam() -> None:
    network, x = network_of([5]), torch.randn(1, 9, 3)
    layers = network.extract(0, torch.float32)
    parameters = [w.requires_grad_() for layer in layers for w in layer if w is not None]
    plain = torch.optim.Adam(parameters, lr=0.01)
    optimizer = StackedAdam(network, 1, 0.01)
    for _ in range(30):
        optimizer.step(loss_of(network(x)))
        plain.zero_grad()
        torch.autograd.backward(loss_of(mlp(layers, x)).sum())
        plain.step()
    expected = torch.cat([p.detach().flatten() for p in parameters])
    torch.testing.assert_close(network.flat[0], expected, rtol=1e-5, atol=1e-6)


def test_it_does_not_import_the_graph_compiler(monkeypatch: pytest.MonkeyPatch) -> None:
    """Importing it takes longer than a short training."""
    monkeypatch.setitem(sys.modules, "torch._dynamo", None)
    network = network_of([5])
    StackedAdam(network, 1, 0.01).step(loss_of(network(torch.ones(1, 9, 3))))


@pytest.mark.parametrize("n_seeds", [2, 3, 5])
def test_a_seed_has_the_bits_of_a_lone_one(n_seeds: int) -> None:
    """Rows of 57 numbers begin and end anywhere in vectors, and Adam rounds all alike."""
    shape = MLPShape(3, (9,), 2, layer_norm=True)
    generator = torch.Generator().manual_seed(0)
    flat, alone = torch.randn(n_seeds, n_parameters(shape), generator=generator), []
    gradients = torch.randn(40, n_seeds, n_parameters(shape), generator=generator)
    for rows in [slice(0, n_seeds), *(slice(k, k + 1) for k in range(n_seeds))]:
        network = StackedMLP(shape, rows.stop - rows.start, "cpu")
        network.flat.copy_(flat[rows])
        optimizer = StackedAdam(network, rows.stop - rows.start, 0.01)
        for gradient in gradients:
            network.gradient.copy_(gradient[rows])
            optimizer.descend()
        alone.append(torch.cat([network.flat, *list(optimizer.state_dict().values())[1:]]))
    together = alone.pop(0).view(3, n_seeds, -1)
    assert torch.equal(together, torch.stack(alone, 1))


def test_the_linear_decay_ends_at_its_floor() -> None:
    assert [linear(p, 0.2) for p in (0.0, 0.5, 1.0, 2.0)] == pytest.approx([1.0, 0.6, 0.2, 0.2])


def test_a_scale_of_zero_moves_nothing_and_is_forgotten() -> None:
    network, x = network_of([5]), torch.randn(1, 9, 3)
    before = network.flat.clone()
    optimizer = StackedAdam(network, 1, 0.01)
    optimizer.step(loss_of(network(x)), scale=0.0)
    assert torch.equal(network.flat, before)
    optimizer.step(loss_of(network(x)))
    moved = (network.flat - before).abs().max().item()
    assert 0.005 < moved <= 0.011


def test_gradients_are_clipped_seed_by_seed_over_all_rows_of_a_seed() -> None:
    gradient = torch.tensor([[3.0, 0.0], [0.0, 4.0], [0.3, 0.0], [0.0, 0.4]])  # norms 5 and 0.5
    norms = clip_per_seed(gradient, n_seeds=2, max_norm=1.0)
    torch.testing.assert_close(norms, torch.tensor([5.0, 0.5]))
    expected = torch.tensor([[0.6, 0.0], [0.0, 0.8], [0.3, 0.0], [0.0, 0.4]])
    torch.testing.assert_close(gradient, expected)


def test_the_cosine_falls_from_one_to_its_floor() -> None:
    assert cosine(0, 100) == 1.0
    assert cosine(50, 100, floor=0.2) == pytest.approx(0.6)
    assert cosine(100, 100, floor=0.2) == pytest.approx(0.2)
    assert cosine(500, 100) == pytest.approx(0.0)


def descent_of(first_seed: int = 0) -> Descent:
    networks = {name: StackedMLP(MLPShape(3, (4,), 1), 2, "cpu") for name in ("one", "other")}
    for stream, network in enumerate(networks.values()):
        initialize(network, (first_seed, first_seed + 1), stream)
    return Descent(networks, 2, 0.01, 1.0, followed=("one",))


def step(descent: Descent) -> None:
    x = torch.ones(2, 5, 3)
    outputs = [network(x) for network in descent.networks.values()]
    descent.step(sum(out.square().mean((1, 2)) for out in outputs))
    descent.follow(0.25)


def test_all_networks_move_and_targets_follow_theirs() -> None:
    descent = descent_of()
    old = {name: network.flat.clone() for name, network in descent.networks.items()}
    step(descent)
    for name, network in descent.networks.items():
        assert not torch.equal(network.flat, old[name]), name
    assert list(descent.targets) == ["one"]
    moved = old["one"] + 0.25 * (descent.networks["one"].flat - old["one"])
    torch.testing.assert_close(descent.targets["one"].flat, moved)
