"""ICQL-QS: whose next actions the targets take, and what happens at the ends of episodes."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from swarmdata.errors import SchemaError
from swarmdata.learn.networks.critics import RobotView
from swarmdata.offline_algos.icql_qs import ICQLQS
from swarmdata.types import Batch
from tests.offline_algos.toys import made, random_batch, two_episodes
from tests.support.memory_dataset import MemoryDataset


def targets_actions(algorithm: Any, batch: Batch) -> tuple[Tensor, Tensor]:
    """Each robot's action, and those of the others, that its target values, two [K, B, N, A]."""
    seen: list[tuple[Tensor, Tensor]] = []

    def record(view: RobotView, actions: Tensor, others: Tensor) -> Tensor:
        seen.append((actions, others))
        return torch.zeros(actions.shape[0], 2, *actions.shape[1:3])

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(algorithm.critics, "target_q", record)
        algorithm.targets(batch)
    return seen[0]


@settings(deadline=None, max_examples=10)
@given(seed=st.integers(0, 1000))
def test_each_robot_leaves_the_data_alone_and_after_a_cut_all_do(seed: int) -> None:
    algorithm, batch = made(ICQLQS, 2, smoothing=0.0), random_batch(2, 40)
    cut = torch.rand(2, 40, generator=torch.Generator().manual_seed(seed)) < 0.3
    batch = replace(batch, truncations=cut)
    own, others = targets_actions(algorithm, batch)
    pi = algorithm.actor(batch.next_observations)
    assert torch.equal(own, pi)
    wanted = torch.where(cut[..., None, None], pi, batch.next_actions)
    assert torch.equal(others, wanted)


def test_next_actions_are_those_of_the_same_episode() -> None:
    """Actions tell the episode and the time; none of another episode's is ever a target's."""
    times = np.array([0.0, 0.05], dtype=np.float32)[:, None, None]
    episodes = [
        replace(e, actions=np.full_like(e.actions, 0.1 * k) + times)
        for k, e in enumerate(two_episodes().episodes, start=1)
    ]
    batch = MemoryDataset(episodes).sampler().gather(np.arange(4)[None]).to_torch()
    algorithm = made(ICQLQS, smoothing=0.0)
    own, others = targets_actions(algorithm, batch)
    for row, following in ((0, 0.15), (2, 0.25)):  # the first step of each episode
        torch.testing.assert_close(others[0, row], torch.full((2, 2), following))
    assert torch.equal(others[0, 3], own[0, 3])  # cut: nobody acted next
    # row 1 ended by a termination: whatever was valued, nothing of it is bootstrapped
    assert algorithm.targets(batch)[0, 1].tolist() == pytest.approx([5.0, 7.0])


def test_batches_without_next_actions_are_refused() -> None:
    batch = replace(random_batch(), next_actions=None)
    with pytest.raises(SchemaError, match="no next_actions, expected those of the data"):
        made(ICQLQS).update(batch)
