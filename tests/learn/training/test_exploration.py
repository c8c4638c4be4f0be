"""Exploration: schedules, and draws that depend on nothing but the seed."""

import numpy as np
import pytest
import torch

from swarmdata.errors import SchemaError
from swarmdata.learn.networks.network_inputs import generators
from swarmdata.online_algos.collection.replay_collection import (
    LinearSchedule,
    epsilon_greedy,
    gaussian,
)


def test_a_schedule_falls_and_stays() -> None:
    schedule = LinearSchedule(1.0, 0.2, duration=0.5)
    assert [schedule.at(p) for p in (0.0, 0.25, 0.5, 0.9, 1.0)] == pytest.approx(
        [1.0, 0.6, 0.2, 0.2, 0.2]
    )
    with pytest.raises(SchemaError, match="expected above 0"):
        LinearSchedule(1.0, 0.2, duration=0.0)


def test_noise_has_its_deviation_and_stays_in_the_box() -> None:
    zeros = torch.zeros(2, 20_000)
    noisy = gaussian(generators([0, 1], "cpu"), zeros, 0.2)
    torch.testing.assert_close(noisy.std(1), torch.full((2,), 0.2), rtol=0.02, atol=0)
    wild = gaussian(generators([0, 1], "cpu"), zeros, 5.0)
    assert wild.abs().max() == 1
    assert torch.equal(gaussian(generators([0, 1], "cpu"), zeros, 0.0), zeros)


def test_a_robot_replaces_all_its_choices_with_probability_epsilon() -> None:
    best = torch.full((1, 4000, 3, 2), 4)
    chosen = epsilon_greedy(generators([5], "cpu"), best, 9, 0.3)
    changed = chosen != best
    # a uniform choice is the best one in 1 of 9 cases
    assert changed.float().mean().item() == pytest.approx(0.3 * 8 / 9, abs=0.01)
    both = changed.all(-1).float().mean().item()
    assert both == pytest.approx(0.3 * (8 / 9) ** 2, abs=0.01)
    _, counts = np.unique(chosen[changed].numpy(), return_counts=True)
    assert len(counts) == 8
    assert counts.max() < 1.2 * counts.min()


def test_no_epsilon_no_change() -> None:
    best = torch.randint(9, (2, 5, 3, 2), generator=torch.Generator().manual_seed(0))
    assert torch.equal(epsilon_greedy(generators([0, 1], "cpu"), best, 9, 0.0), best)


def test_streams_of_a_seed_differ() -> None:
    draws = [torch.rand(3, generator=generators([1], "cpu", s)[0]).tolist() for s in (None, 0, 1)]
    assert len({tuple(draw) for draw in draws}) == 3
