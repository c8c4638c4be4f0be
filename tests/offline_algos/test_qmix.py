"""Offline QMIX: its mixing, overestimation on narrow data, and what stops it."""

import pytest

torch = pytest.importorskip("torch", reason="algorithms need torch")

from swarmdata.offline_algos.qmix import QMIX  # noqa: E402
from swarmdata.testing.memory_dataset import MemoryDataset  # noqa: E402
from tests.offline_algos.toys import actions_of, progress_of, trained  # noqa: E402


def test_the_state_weighs_the_robots(mixture: MemoryDataset) -> None:
    algorithm, _ = trained(QMIX, mixture, 1, hidden=(8,))
    values, states = torch.randn(2, 2, 5, 2), torch.randn(2, 5, 8)
    mixed = algorithm.mix(values, states)
    assert mixed.shape == (2, 2, 5)
    assert (algorithm.mix(values + 1, states) >= mixed).all()
    assert not torch.allclose(algorithm.mix(values, states + 1), mixed)
    assert {"networks.mixer", "networks.target_mixer"} <= algorithm.state_dict().keys()


@pytest.mark.learns
@pytest.mark.parametrize("regulariser", ["bc", "bcq", "cql"])
def test_it_beats_its_data(mixture: MemoryDataset, regulariser: str) -> None:
    """Half of the data drive at the goal, the other half at random: 0.03 a step."""
    algorithm, _ = trained(QMIX, mixture, 500, regulariser=regulariser)
    observations = mixture.transitions["observations"]
    for seed in range(2):
        assert progress_of(actions_of(algorithm.policy(seed), observations), observations) > 0.08


@pytest.mark.learns
def test_without_a_regulariser_it_overestimates_narrow_data(good_only: MemoryDataset) -> None:
    """Good data only: what they lack is valued by guesses, which the bootstrap then spreads."""
    observations = good_only.transitions["observations"]
    value, progress = {}, {}
    for regulariser in ("none", "bc"):
        algorithm, losses = trained(QMIX, good_only, 500, regulariser=regulariser)
        value[regulariser] = losses[-1]["q"]  # 2.07 against 1.25
        policies = [algorithm.policy(seed) for seed in range(2)]
        each = [progress_of(actions_of(policy, observations), observations) for policy in policies]
        progress[regulariser] = sum(each) / 2  # 0.07 against 0.12
    assert value["none"] > value["bc"] + 0.1
    assert progress["bc"] > progress["none"] + 0.015
