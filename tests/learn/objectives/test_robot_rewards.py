"""Rewards of robots and teams: their scale, their bound, and the range of returns."""

import math

import pytest

torch = pytest.importorskip("torch", reason="algorithms need torch")

from swarmdata.learn.objectives.robot_rewards import RobotRewards  # noqa: E402
from tests.offline_algos.toys import statistics  # noqa: E402

CHANGES = {
    "return_std": 2.0, "max_return": 3.0, "return_range": 10.0,
    "own_return_std": 4.0, "own_max_return": 8.0, "own_return_range": 40.0,
}  # fmt: skip


def test_own_rewards_stay_apart_and_have_their_own_scale() -> None:
    rewards = RobotRewards(statistics(**CHANGES), "own", clip_target=True)
    scaled = rewards(torch.tensor([[[1.0, 3.0]]]))
    torch.testing.assert_close(scaled, torch.tensor([[[0.25, 0.75]]]))
    assert (rewards.max_value, rewards.return_range) == (2.0, 10.0)


def test_of_a_team_all_robots_have_the_mean() -> None:
    rewards = RobotRewards(statistics(**CHANGES), "team")
    scaled = rewards(torch.tensor([[[1.0, 3.0]]]))
    torch.testing.assert_close(scaled, torch.tensor([[[1.0, 1.0]]]))
    assert (rewards.max_value, rewards.return_range) == (math.inf, 5.0)
