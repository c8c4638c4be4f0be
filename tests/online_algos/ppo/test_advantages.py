"""Advantages by hand, on two episodes that meet, and the scale of value targets."""

import numpy as np
import pytest

pytest.importorskip("torch", reason="online algorithms need the torch extra")

from swarmdata.online_algos.ppo.advantages import TargetScale, generalized_advantages, normalized


def advantages_of(terminated: bool, cut: bool) -> np.ndarray:
    """Two steps of one copy and one robot; the first step may end an episode."""
    rewards = np.array([1.0, 2.0], np.float32).reshape(2, 1, 1)
    values = np.array([10.0, 20.0], np.float32).reshape(2, 1, 1)
    next_values = np.array([7.0, 30.0], np.float32).reshape(2, 1, 1)  # 7: the episode's last state
    terminations = np.array([[terminated], [False]])
    ended = np.array([[terminated or cut], [False]])
    found = generalized_advantages(rewards, values, next_values, terminations, ended, 0.5, 0.5)
    return found[:, 0, 0]


def test_advantages_flow_inside_an_episode() -> None:
    second = 2 + 0.5 * 30 - 20
    wanted = [1 + 0.5 * 7 - 10 + 0.25 * second, second]
    np.testing.assert_allclose(advantages_of(False, False), wanted)


def test_truncation_bootstraps_but_nothing_crosses_the_end() -> None:
    np.testing.assert_allclose(advantages_of(False, True), [1 + 0.5 * 7 - 10, -3.0])


def test_termination_stops_the_bootstrap() -> None:
    np.testing.assert_allclose(advantages_of(True, False), [1 - 10, -3.0])


def test_advantages_are_normalized_for_each_seed() -> None:
    values = np.random.default_rng(0).normal(size=(5, 2, 3, 4)).astype(np.float32)
    values[:, 1] = 7 * values[:, 1] + 3
    found = normalized(values)
    np.testing.assert_allclose(found.mean((0, 2, 3)), 0, atol=1e-6)
    np.testing.assert_allclose(found.std((0, 2, 3)), 1, atol=1e-5)


def test_the_scale_of_a_seed_follows_its_targets_only() -> None:
    scale = TargetScale(2)
    targets = np.zeros((4, 2, 3, 1), np.float32)
    targets[:, 1] = np.array([1.0, 5.0, 1.0, 5.0])[:, None, None]
    for _ in range(3):
        scale.update(targets)
    np.testing.assert_allclose(scale.mean, [0.0, 3.0], atol=1e-12)
    np.testing.assert_allclose(scale.std, [0.01, 2.0], atol=1e-9)
    np.testing.assert_allclose(scale.denormalize(scale.normalize(targets)), targets, atol=1e-6)
