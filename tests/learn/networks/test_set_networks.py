"""Networks over sets: no order, no padding, any number of slots, and a seed alone as in a stack."""

from dataclasses import replace

import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from swarmdata.learn.networks.perceptrons import initialize
from swarmdata.learn.networks.set_networks import SetShape, StackedSets, over_sets
from swarmdata.perception.feature_slots import SlotKind, Slots


def slots_with(n_neighbors: int, n_goals: int) -> Slots:
    """Two own columns, slots (x, y, mask) of neighbors, then slots (x) of goals without a mask."""
    near = [2 + 3 * k for k in range(n_neighbors)]
    goals = tuple((2 + 3 * n_neighbors + k,) for k in range(n_goals))
    kinds = (
        SlotKind(
            "neighbor", ("x", "y"), tuple((c, c + 1) for c in near), tuple(c + 2 for c in near)
        ),
        SlotKind("goal", ("x",), goals, ()),
    )
    return Slots(2 + 3 * n_neighbors + n_goals, ("a", "b"), (0, 1), kinds)


def made(seeds: tuple[int, ...] = (4, 9)) -> StackedSets:
    network = StackedSets(SetShape(slots_with(3, 2), (8, 6), 2), len(seeds), "cpu")
    initialize(network, seeds, 0)
    return network


def rows(seed: int = 0, n_rows: int = 11) -> Tensor:
    generator = torch.Generator().manual_seed(seed)
    inputs = torch.randn(2, n_rows, 13, generator=generator)
    inputs[..., [4, 7, 10]] = (torch.rand(2, n_rows, 3, generator=generator) < 0.6).float()
    return inputs


@settings(deadline=None, max_examples=25)
@given(order=st.permutations(range(3)), seed=st.integers(0, 1000))
def test_the_order_of_slots_does_not_matter(order: list[int], seed: int) -> None:
    """To rounding: a product rounds by the place of its row; a maximum has no order."""
    inputs = rows(seed)
    turned = inputs.clone()
    for k, other in enumerate(order):
        turned[..., 2 + 3 * k : 5 + 3 * k] = inputs[..., 2 + 3 * other : 5 + 3 * other]
    turned[..., [11, 12]] = inputs[..., [12, 11]]
    torch.testing.assert_close(made()(turned), made()(inputs), rtol=0, atol=1e-6)


@settings(deadline=None, max_examples=25)
@given(seed=st.integers(0, 1000), value=st.floats(-1e3, 1e3, width=32))
def test_empty_slots_have_no_effect_whatever_they_hold(seed: int, value: float) -> None:
    inputs = rows(seed)
    filled = inputs.clone()
    for k in range(3):
        empty = inputs[..., 4 + 3 * k] == 0
        filled[..., 2 + 3 * k : 4 + 3 * k][empty] = value
    assert torch.equal(made()(filled), made()(inputs))


def test_more_empty_slots_change_nothing_and_a_new_neighbor_does() -> None:
    """To rounding: products of other shapes sum in another order."""
    network, inputs = made(), rows()
    wide = slots_with(5, 2)
    padded = torch.cat([inputs[..., :11], torch.zeros(2, 11, 6), inputs[..., 11:]], -1)
    shape = replace(network.shape, slots=wide)
    answers = over_sets(shape, network.layers, padded)
    torch.testing.assert_close(answers, network(inputs))
    padded[..., 11:14] = torch.tensor([2.0, -3.0, 1.0])
    assert not torch.allclose(over_sets(shape, network.layers, padded), network(inputs))


def test_an_empty_set_is_zero_and_kinds_may_be_absent() -> None:
    network, inputs = made(), rows()
    inputs[..., [4, 7, 10]] = 0.0
    shape = replace(network.shape, slots=slots_with(0, 2))
    without = torch.cat([inputs[..., :2], inputs[..., 11:]], -1)
    torch.testing.assert_close(over_sets(shape, network.layers, without), network(inputs))


def test_every_layer_learns() -> None:
    network = made()
    network.backward(network(rows(n_rows=200)).square().sum())
    for _, gradient in network._leaves():
        assert gradient.any(1).any(1).all()
