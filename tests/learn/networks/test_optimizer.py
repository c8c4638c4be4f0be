"""The stacked Adam against torch's plain one, clipping, and the cosine."""

import pytest

torch = pytest.importorskip("torch", reason="the toolbox needs torch")

from torch import Tensor  # noqa: E402

from swarmdata.learn.networks.optimizer import StackedAdam, clip_per_seed, cosine, linear  # noqa: E402
from swarmdata.learn.networks.perceptrons import MLPShape, StackedMLP, backward, initialize, mlp  # noqa: E402

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


def test_two_networks_descend_on_one_loss() -> None:
    """A backward pass through both gives what one pass for each gives."""
    first, second, x = (
        network_of([5]),
        StackedMLP(MLPShape(2, (), 1), 1, "cpu"),
        torch.randn(1, 9, 3),
    )
    initialize(second, [6], 0)
    first.backward(second(first(x)).square().sum())
    second.backward(second(first(x)).square().sum())
    expected = first.gradient.clone(), second.gradient.clone()
    before = second.flat.clone()
    backward(second(first(x)).square().sum(), [first, second])
    torch.testing.assert_close((first.gradient, second.gradient), expected)
    StackedAdam(second, 1, 0.01).descend()
    assert (torch.sign(before - second.flat) == torch.sign(second.gradient)).all()


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


def test_the_optimizer_clips() -> None:
    network, x = network_of([5, 6]), 100 * torch.randn(2, 9, 3)
    optimizer = StackedAdam(network, 2, 0.01, max_norm=0.5)
    optimizer.step(loss_of(network(x)))
    norms = network.gradient.norm(dim=1)
    torch.testing.assert_close(norms, torch.tensor([0.5, 0.5]), rtol=1e-4, atol=0)


def test_a_restored_state_continues_bit_for_bit() -> None:
    x = torch.randn(1, 9, 3)
    one, two = network_of([5]), network_of([5])
    first, second = (StackedAdam(network, 1, 0.01) for network in (one, two))
    second.load_state_dict(first.state_dict())  # before the first step
    for _ in range(3):
        first.step(loss_of(one(x)))
    two.load(one.flat)
    second.load_state_dict(first.state_dict())
    for optimizer, network in ((first, one), (second, two)):
        optimizer.step(loss_of(network(x)))
    assert torch.equal(one.flat, two.flat)


def test_the_cosine_falls_from_one_to_its_floor() -> None:
    assert cosine(0, 100) == 1.0
    assert cosine(50, 100, floor=0.2) == pytest.approx(0.6)
    assert cosine(100, 100, floor=0.2) == pytest.approx(0.2)
    assert cosine(500, 100) == pytest.approx(0.0)
