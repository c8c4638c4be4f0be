"""ICQL-QS: whose next actions the targets take, and what happens at the ends of episodes."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="algorithms need torch")

from hypothesis import given, settings  # noqa: E402
from hypothesis import strategies as st  # noqa: E402
from torch import Tensor  # noqa: E402

from swarmdata.errors import SchemaError  # noqa: E402
from swarmdata.offline_algos.icql_qs import ICQLQS  # noqa: E402
from swarmdata.testing.memory_dataset import MemoryDataset  # noqa: E402
from swarmdata.types import Batch  # noqa: E402
from tests.offline_algos.toys import made, random_batch, two_episodes  # noqa: E402


def targets_actions(algorithm: Any, batch: Batch) -> Tensor:
    """Joint actions that the targets value, [K, B, N, A]."""
    seen: list[Tensor] = []

    def record(x: Tensor, actions: Tensor) -> Tensor:
        seen.append(actions)
        return torch.zeros(*x.shape[:1], 2, x.shape[1], 1)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(algorithm.critics, "target_q", record)
        algorithm.targets(batch)
    return seen[0]


@settings(deadline=None, max_examples=10)
@given(seed=st.integers(0, 1000))
def test_one_agent_leaves_the_data_and_after_a_cut_all_do(seed: int) -> None:
    algorithm, batch = made(ICQLQS, 2, smoothing=0.0), random_batch(2, 40)
    algorithm.generators[0].manual_seed(seed)
    cut = torch.rand(2, 40, generator=torch.Generator().manual_seed(seed)) < 0.3
    batch = replace(batch, truncations=cut)
    chosen = targets_actions(algorithm, batch)
    pi = algorithm.actor(batch.next_observations)
    ours = (chosen == pi).all(-1)  # [K, B, N]
    theirs = (chosen == batch.next_actions).all(-1)
    assert (ours != theirs).all()
    torch.testing.assert_close(ours.sum(2), torch.where(cut, 2, 1))


def test_every_agent_leaves_equally_often() -> None:
    algorithm, batch = made(ICQLQS, smoothing=0.0), random_batch(1, 2000)
    batch = replace(batch, truncations=torch.zeros_like(batch.truncations))
    stays = (targets_actions(algorithm, batch) == batch.next_actions).all(-1)
    assert stays.float().mean(1)[0].tolist() == pytest.approx([0.5, 0.5], abs=0.05)


def test_next_actions_are_those_of_the_same_episode() -> None:
    """Actions tell the episode and the time; none of another episode's is ever a target's."""
    times = np.array([0.0, 0.05], dtype=np.float32)[:, None, None]
    episodes = [
        replace(e, actions=np.full_like(e.actions, 0.1 * k) + times)
        for k, e in enumerate(two_episodes().episodes, start=1)
    ]
    batch = MemoryDataset(episodes).sampler().gather(np.arange(4)[None]).to_torch()
    algorithm = made(ICQLQS, smoothing=0.0)
    chosen = targets_actions(algorithm, batch)
    pi = algorithm.actor(batch.next_observations)
    for row, following in ((0, 0.15), (2, 0.25)):  # the first step of each episode
        left = (chosen[0, row] == pi[0, row]).all(-1)
        assert left.sum() == 1
        torch.testing.assert_close(chosen[0, row][~left], torch.full((1, 2), following))
    assert torch.equal(chosen[0, 3], pi[0, 3])  # cut: nobody acted next
    # row 1 ended by a termination: whatever was valued, nothing of it is bootstrapped
    assert algorithm.targets(batch)[0, 1].item() == pytest.approx(6.0)


def test_batches_without_next_actions_are_refused() -> None:
    batch = replace(random_batch(), next_actions=None)
    with pytest.raises(SchemaError, match="no next_actions, expected those of the data"):
        made(ICQLQS).update(batch)
