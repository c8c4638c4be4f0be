"""Offline VDN: its mixing, and that it improves on its data."""

import pytest

torch = pytest.importorskip("torch", reason="algorithms need torch")

from swarmdata.learn.choices.utility_networks import LOSSES  # noqa: E402
from swarmdata.offline_algos.vdn import VDN  # noqa: E402
from swarmdata.testing.memory_dataset import MemoryDataset  # noqa: E402
from tests.offline_algos.toys import actions_of, progress_of, trained  # noqa: E402


def test_the_team_is_worth_the_mean_of_its_robots(mixture: MemoryDataset) -> None:
    algorithm, losses = trained(VDN, mixture, 1, hidden=(8,))
    utilities, weights = torch.randn(2, 2, 5, 2, 2, 9), torch.rand(2, 5, 2, 2, 9)
    each = (utilities * weights[:, None]).sum(-1).mean(-1)  # [K, J, B, N]
    value = algorithm.value(utilities, weights, torch.zeros(2, 5, 8))
    torch.testing.assert_close(value, each.mean(-1))
    assert set(losses[0]) <= set(LOSSES) == set(VDN.LOSSES)
    assert not any("mixer" in name for name in algorithm.state_dict())


@pytest.mark.learns
@pytest.mark.parametrize("regulariser", ["bc", "bcq", "cql"])
def test_it_beats_its_data(mixture: MemoryDataset, regulariser: str) -> None:
    """Half of the data drive at the goal, the other half at random: 0.03 a step."""
    algorithm, _ = trained(VDN, mixture, 500, regulariser=regulariser)
    observations = mixture.transitions["observations"]
    for seed in range(2):
        assert progress_of(actions_of(algorithm.policy(seed), observations), observations) > 0.08
