"""Mixers: monotonic in every robot, dependent on the state, seed by seed."""

import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from swarmdata.learn.networks.mixers import HyperMixer, LinearMixer
from swarmdata.learn.networks.setup import Setup, Sizes
from tests.offline_algos.toys import statistics

SEEDS = [4, 9]


def made() -> HyperMixer:
    return HyperMixer(3, 5, SEEDS, 1, embedding=7, hidden=6, device="cpu")


def drawn(seed: int, n_seeds: int = 2) -> tuple[Tensor, Tensor]:
    generator = torch.Generator().manual_seed(seed)
    values = 3 * torch.randn(n_seeds, 11, 3, generator=generator)
    return values, torch.randn(n_seeds, 11, 5, generator=generator)


@given(seed=st.integers(0, 999), robot=st.integers(0, 2), rise=st.floats(0, 10))
def test_a_robots_rise_never_lowers_the_teams_value(seed: int, robot: int, rise: float) -> None:
    mixer, (values, states) = made(), drawn(seed)
    higher = values.clone()
    higher[..., robot] += rise
    assert (mixer(higher, states) >= mixer(values, states) - 1e-5).all()


def test_other_parameters_can_be_used() -> None:
    mixer, (values, states) = made(), drawn(5)
    target = mixer.network.clone()
    before = mixer(values, states, target)
    mixer.network.flat.mul_(2)
    assert torch.equal(mixer(values, states, target), before)
    assert not torch.allclose(mixer(values, states), before)


def test_twin_mixers_are_neighbors_and_differ() -> None:
    twins = HyperMixer(3, 5, SEEDS, 1, embedding=7, hidden=6, device="cpu", n_critics=2)
    assert len(twins.network.flat) == 4
    assert len({tuple(row) for row in twins.network.flat.tolist()}) == 4
    single = HyperMixer(3, 5, SEEDS[1:], 1, embedding=7, hidden=6, device="cpu", n_critics=2)
    assert torch.equal(twins.network.flat[2:], single.network.flat)


def linear() -> LinearMixer:
    """Of 3 robots; x has 5 numbers."""
    sizes = Sizes(n_agents=3, observation=1, action=1, state=2)
    return LinearMixer(Setup(sizes, SEEDS, statistics()), 6)


def test_the_linear_mixer_by_hand() -> None:
    mixer, (values, states) = linear(), drawn(4)
    states *= 30  # some weights would be negative
    raw = mixer.network(states)[0, 7]
    assert raw[:3].min() < -1
    expected = ((1 + raw[:3]).abs() / 3 * values[0, 7]).sum() + raw[3]
    torch.testing.assert_close(mixer(values, states)[0, 7], expected)
