"""Robots settle on one convention, and keep it without a word."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="algorithms need torch")

from swarmdata.errors import SchemaError  # noqa: E402
from swarmdata.learn.networks.setup import Setup  # noqa: E402
from swarmdata.offline_algos.inspo import InSPO, InSPOConfig, Leanings, of_others  # noqa: E402
from swarmdata.testing.memory_dataset import MemoryDataset  # noqa: E402
from swarmdata.types import Float  # noqa: E402
from tests.offline_algos.toys import (  # noqa: E402
    SIZES,
    actions_of,
    configured,
    random_batch,
    statistics,
    trained,
)
from tests.support.made_episodes import made_episode  # noqa: E402


def xor_game(n_episodes: int = 50, length: int = 20) -> MemoryDataset:
    """A matrix game of two robots: half of the teams play (+, -), the other half (-, +).

    The second component is the choice, 0.8 in size; nothing is observed. No data have (+, +) or
    (-, -), which would be worth nothing.
    """
    rng = np.random.default_rng(0)
    episodes = []
    for number in range(n_episodes):
        actions = np.zeros((length, 2, 2))
        actions[..., 1] = 0.8 * (-1.0) ** (number + np.arange(2))
        actions += rng.normal(0, 0.05, actions.shape)
        episodes.append(
            made_episode(
                np.zeros((length + 1, 2, 3)), np.zeros((length + 1, 4)), actions,
                np.ones((length, 2)), ends=False, seed=number,
            )
        )  # fmt: skip
    return MemoryDataset(episodes)


def test_a_row_weighs_what_the_others_would_do_there_and_in_its_episode() -> None:
    """By hand: log rho of the robots is -1, 2, and 4 of the one that has its turn."""
    assert of_others(torch.tensor([[[-1.0, 2.0, 4.0]]])).tolist() == [[[6.0, 3.0, 1.0]]]
    leanings = Leanings(Setup(SIZES, (0, 1), statistics(), n_episodes=3))
    episodes = torch.tensor([[0, 2], [1, 1]])
    leanings.learn(episodes, torch.tensor([[[1.0, 0.0], [2.0, -2.0]]] * 2), 0.5)
    assert leanings.values[0].tolist() == [[0.5, 0.0], [0.0, 0.0], [1.0, -1.0]]
    assert leanings.values[1].tolist() == [[0.0, 0.0], [1.5, -1.0], [0.0, 0.0]]  # of two rows
    leanings.learn(episodes, torch.tensor([[[1.0, 0.0], [2.0, -2.0]]] * 2), 0.5)
    assert leanings.of(episodes)[0].tolist() == [[0.75, 0.0], [1.5, -1.5]]
    fresh = Leanings(Setup(SIZES, (0, 1), statistics(), n_episodes=3))
    fresh.load_state_dict(leanings.state_dict())
    assert torch.equal(fresh.values, leanings.values)


def small(**config: Any) -> InSPO:
    setup = Setup(SIZES, (0,), statistics(), n_episodes=1)
    return InSPO(setup, configured(InSPO, {"value_hidden": (8,)}, config))


def test_in_the_first_stage_robots_clone_and_clones_stay_in_the_second() -> None:
    algorithm = small(n_updates=4, hidden=(8,), settling_share=0.5, n_components=1)
    batch = replace(random_batch(), episodes=torch.zeros(1, 32, dtype=torch.long))
    losses = []
    for update in range(4):
        if update == 2:
            cloned = algorithm.actor.network.flat.clone()
        outputs = algorithm.actor(batch.observations)[..., 1:].tanh()
        errors = (outputs - batch.actions).square().mean(3).detach()
        losses.append(algorithm.update(batch))
        if update < 2:  # an equal weight of all rows
            torch.testing.assert_close(losses[update]["actor_loss"], errors.mean((1, 2)))
    shares = [each["effective_share"].item() for each in losses]
    assert shares[:2] == pytest.approx([1, 1])
    assert max(shares[2:]) < 0.9
    assert losses[2]["log_ratio"].item() == pytest.approx(0, abs=1e-5)  # pi is mu
    assert losses[3]["log_ratio"].item() != 0
    assert torch.equal(algorithm.clones.flat, cloned)


def test_episodes_must_be_known() -> None:
    with pytest.raises(SchemaError, match="expected their number"):
        InSPO(Setup(SIZES, (0,), statistics()), InSPOConfig())
    with pytest.raises(SchemaError, match="above 0 and below 1"):
        InSPOConfig(settling_share=1.0)


def choices(n_updates: int, ratio_exponent: float) -> Float:
    """What the robots of six seeds choose, [6, 2]."""
    algorithm, _ = trained(
        InSPO, xor_game(), n_updates, seeds=range(6),
        ratio_exponent=ratio_exponent, settling_share=0.75, hidden=(16,), value_hidden=(8,),
        batch_size=64,
    )  # fmt: skip
    nothing = np.zeros((1, 2, 3), np.float32)
    return np.stack([actions_of(algorithm.policy(k), nothing)[0, :, 1] for k in range(6)])


def test_a_matrix_game_of_two_conventions_settles_on_one() -> None:
    found = choices(500, 4.0)
    assert (np.abs(np.abs(found) - 0.8) < 0.1).all()  # a choice, not the middle
    assert (found[:, 0] * found[:, 1] < 0).all()
    alone = choices(150, 0.0)  # clones of each robot's own part agree by chance
    assert (alone[:, 0] * alone[:, 1] > 0).any()
