"""Robots that improve in turn settle on one convention, and keep it without a word."""

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="algorithms need torch")

from swarmdata.offline_algos.inspo import InSPO  # noqa: E402
from swarmdata.testing.memory_dataset import MemoryDataset  # noqa: E402
from swarmdata.types import Float  # noqa: E402
from tests.offline_algos.toys import actions_of, trained  # noqa: E402
from tests.support.made_episodes import made_episode  # noqa: E402


def xor_game(n_episodes: int = 50, length: int = 20) -> MemoryDataset:
    """A matrix game of two robots: in half of the steps (+, -), in the other half (-, +).

    The second component is the choice, 0.8 in size; nothing is observed. No data have (+, +) or
    (-, -), which would be worth nothing.
    """
    rng = np.random.default_rng(0)
    episodes = []
    for number in range(n_episodes):
        actions = np.zeros((length, 2, 2))
        side = rng.choice([-0.8, 0.8], size=length)
        actions[..., 1] = np.stack([side, -side], 1)
        actions += rng.normal(0, 0.05, actions.shape)
        episodes.append(
            made_episode(
                np.zeros((length + 1, 2, 3)), np.zeros((length + 1, 4)), actions,
                np.ones((length, 2)), ends=False, seed=number,
            )
        )  # fmt: skip
    return MemoryDataset(episodes)


def choices(n_updates: int, ratio_exponent: float) -> Float:
    """What the robots of six seeds choose, [6, 2]."""
    algorithm, _ = trained(
        InSPO, xor_game(), n_updates, seeds=range(6),
        ratio_exponent=ratio_exponent, sequential_share=0.75, hidden=(16,), value_hidden=(8,),
        batch_size=32,
    )  # fmt: skip
    nothing = np.zeros((1, 2, 3), np.float32)
    return np.stack([actions_of(algorithm.policy(k), nothing)[0, :, 1] for k in range(6)])


def test_a_matrix_game_of_two_conventions_settles_on_one() -> None:
    found = choices(500, 4.0)
    assert (np.abs(np.abs(found) - 0.8) < 0.1).all()  # a choice, not the middle
    assert (found[:, 0] * found[:, 1] < 0).all()
    alone = choices(150, 0.0)  # clones of each robot's own part agree by chance
    assert (alone[:, 0] * alone[:, 1] > 0).any()
