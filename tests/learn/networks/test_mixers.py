"""Mixers: monotonic in every robot, dependent on the state, seed by seed."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

torch = pytest.importorskip("torch", reason="the toolbox needs torch")

from torch import Tensor  # noqa: E402

from swarmdata.learn.networks.mixers import FreeMixer, LinearMixer, MonotonicMixer  # noqa: E402

SEEDS = [4, 9]


def made(seeds: list[int] = SEEDS) -> MonotonicMixer:
    return MonotonicMixer(3, 5, seeds, 1, embedding=7, hidden=6, device="cpu")


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
    assert mixer.network is not None
    target = mixer.network.clone()
    before = mixer(values, states, target)
    mixer.network.flat.mul_(2)
    assert torch.equal(mixer(values, states, target), before)
    assert not torch.allclose(mixer(values, states), before)


@pytest.mark.parametrize("kind", [MonotonicMixer, FreeMixer])
def test_twin_mixers_are_neighbors_and_differ(kind: type[MonotonicMixer | FreeMixer]) -> None:
    twins = kind(3, 5, SEEDS, 1, embedding=7, hidden=6, device="cpu", n_critics=2)
    assert twins.network is not None
    assert len(twins.network.flat) == 4
    assert len({tuple(row) for row in twins.network.flat.tolist()}) == 4
    single = kind(3, 5, SEEDS[1:], 1, embedding=7, hidden=6, device="cpu", n_critics=2)
    assert single.network is not None
    assert torch.equal(twins.network.flat[2:], single.network.flat)


def linear(seeds: list[int] = SEEDS) -> LinearMixer:
    return LinearMixer(3, 5, seeds, 1, hidden=6, device="cpu")


def test_the_linear_mixer_by_hand() -> None:
    mixer, (values, states) = linear(), drawn(4)
    assert mixer.network is not None
    raw = mixer.network(states)[0, 7]
    expected = ((1 + raw[:3]).abs() / 3 * values[0, 7]).sum() + raw[3]
    torch.testing.assert_close(mixer(values, states)[0, 7], expected)


@given(seed=st.integers(0, 999), robot=st.integers(0, 2), rise=st.floats(0, 10))
def test_linear_weights_are_never_negative_and_say_what_a_rise_is_worth(
    seed: int, robot: int, rise: float
) -> None:
    mixer, (values, states) = linear(), drawn(seed)
    weights, _ = mixer.weights(10 * states)
    assert weights.min() >= 0
    higher = values.clone()
    higher[..., robot] += rise
    gain = mixer(higher, 10 * states) - mixer(values, 10 * states)
    torch.testing.assert_close(gain, rise * weights[..., robot], rtol=1e-4, atol=1e-3)
