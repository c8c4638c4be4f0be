"""The scale of value targets."""

import numpy as np
import pytest

pytest.importorskip("torch", reason="online algorithms need the torch extra")

from swarmdata.online_algos.ppo.networks import ValueScale


def test_the_scale_of_a_seed_follows_its_targets_only() -> None:
    scale = ValueScale(2)
    targets = np.zeros((4, 2, 3, 1), np.float32)
    targets[:, 1] = np.array([1.0, 5.0, 1.0, 5.0])[:, None, None]
    for _ in range(3):
        scale.update(targets)
    np.testing.assert_allclose(scale.mean, [0.0, 3.0], atol=1e-12)
    np.testing.assert_allclose(scale.std, [0.01, 2.0], atol=1e-9)
    np.testing.assert_allclose(scale.denormalize(scale.normalize(targets)), targets, atol=1e-6)
