"""Samples as rows of stacked networks, and the views of states that critics get."""

import numpy as np
import pytest

pytest.importorskip("torch", reason="online algorithms need the torch extra")

import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from swarmdata.online_algos.ppo.rollout_samples import (
    STATE_SCALE,
    critic_states,
    pad_by_seed,
    pick,
    ranks,
    sample_rows,
)
from swarmdata.registry.components import make_env
from swarmdata.specs.task_spec import TaskSpec


def test_each_robot_sees_its_own_state_first() -> None:
    step = make_env(TaskSpec(), 2).reset(np.arange(2, dtype=np.uint64))
    views = critic_states(step).reshape(2, 4, 4, 8)
    rows = step.states.reshape(2, 4, 8) * STATE_SCALE
    for robot in range(4):
        np.testing.assert_array_equal(views[:, robot], np.roll(rows, -robot, axis=1))


def test_rows_keep_seeds_and_robots_apart() -> None:
    t, k, e, n = 2, 3, 4, 5
    codes = np.stack(np.meshgrid(*map(np.arange, (t, k, e, n)), indexing="ij"), -1)
    shared = sample_rows(torch.from_numpy(codes), "shared")
    separate = sample_rows(torch.from_numpy(codes), "separate")
    assert shared.shape == (k, t * e * n, 4)
    assert separate.shape == (k * n, t * e, 4)
    for row in range(k):
        assert (shared[row, :, 1] == row).all()
    for row in range(k * n):
        assert (separate[row, :, 1] == row // n).all()
        assert (separate[row, :, 3] == row % n).all()


@settings(deadline=None)
@given(st.lists(st.integers(0, 3), min_size=1, max_size=30))
def test_padding_loses_nothing(seeds: list[int]) -> None:
    owners = np.array(seeds)
    values = np.random.default_rng(0).normal(size=(len(seeds), 2)).astype(np.float32)
    padded = pad_by_seed(values, owners, 4)
    np.testing.assert_array_equal(padded[owners, ranks(owners)], values)
    np.testing.assert_allclose(padded.sum((0, 1)), values.sum(0), atol=1e-5)


def test_pick_takes_each_rows_own_samples() -> None:
    values = torch.arange(24.0).view(2, 4, 3)
    rows = torch.tensor([[3, 0], [1, 1]])
    np.testing.assert_array_equal(pick(values, rows)[0], values[0, [3, 0]])
    np.testing.assert_array_equal(pick(values, rows)[1], values[1, [1, 1]])
