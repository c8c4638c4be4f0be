"""Recorded and new transitions are sampled together, and a policy is fine-tuned on them."""

from pathlib import Path

import pytest

import swarmdata

pytest.importorskip("torchrl", reason="the extra 'torchrl'")
torch = pytest.importorskip("torch", reason="the extra 'torch'")
pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore::DeprecationWarning")]


def test_it_learns_offline_and_in_the_world(tiny: Path) -> None:
    from tests.examples import offline_to_online as example

    rates = example.main(str(tiny), n_offline=3, n_rounds=2, n_episodes=4)
    assert all(0 <= rate <= 1 for rate in rates)


def test_half_of_a_batch_is_recorded(tiny: Path) -> None:
    from torchrl.data import OfflineToOnlineReplayBuffer

    from tests.examples import offline_to_online as example

    dataset = swarmdata.load(str(tiny))
    assert isinstance(dataset.spec, swarmdata.TaskSpec)
    env = swarmdata.make_torchrl_env(dataset.spec, 2, seed=0)
    recorded = dataset.replay_buffer(None, keys=example.KEYS)
    buffer = OfflineToOnlineReplayBuffer(recorded, online_capacity=100, batch_size=10)
    learner = example.Learner(env.observation_spec["agents", "observation"].shape[-1], 2)
    new = example.collect(env, learner, 20)
    new["next", "agents", "reward"][:] = 77.0
    buffer.extend(new)
    batch = buffer.sample()
    assert (batch["next", "agents", "reward"] == 77.0).all(dim=(1, 2)).sum() == 5
    assert set(batch.keys(True, True)) == set(example.KEYS)
