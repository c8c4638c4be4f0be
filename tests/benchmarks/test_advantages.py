"""What critics know of actions: which steps count, and what the correlations say."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch", reason="training needs the torch extra")

import torch

import swarmdata
from tests.benchmarks import bench_advantages
from tests.benchmarks.bench_advantages import HEAD, Known, Rows, measure, row_of, steps_of
from tests.support.one_process import use_one_process
from tests.support.tiny import make_tiny

DISCOUNT = 0.5  # 4 steps are left out: 0.5^4 < 0.1


def rows(n_episodes: int, length: int) -> Rows:
    """Robots whose returns are all different."""
    n = n_episodes * length
    returns = torch.randn(n, 2, generator=torch.Generator().manual_seed(0))
    empty = torch.zeros(n, 1)
    episodes = np.repeat(np.arange(n_episodes), length).astype(np.float64)
    return Rows(empty, empty, empty, returns, episodes)


def test_the_correlation_is_that_of_advantages_and_surplus_returns() -> None:
    recorded = rows(20, 10)
    noise = torch.randn(200, 2, generator=torch.Generator().manual_seed(1))
    knows = Known(recorded.returns, 0.1 * recorded.returns, recorded.returns, 0.9)
    guesses = Known(-recorded.returns, noise, recorded.returns, 0.8)
    name, fits, told, deviation, surplus, slopes = row_of("x", recorded, [knows])
    assert (name, fits, told, slopes) == ("`x`", "1.00", "1.00 (1.00 to 1.00)", "0.90")
    assert float(deviation) == pytest.approx(0.1 * float(surplus), rel=0.02)
    _, fits, told, *_ = row_of("x", recorded, [guesses])
    assert fits == "-1.00"
    low, high = (float(end) for end in told.partition("(")[2].rstrip(")").split(" to "))
    assert -0.25 < low < 0.0 < high < 0.25


def test_steps_with_an_unknown_rest_do_not_count_and_a_measurement_has_a_row(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    use_one_process(monkeypatch)
    data = make_tiny(tmp_path / "coop_nav-tiny-v0")
    episode = swarmdata.load(data)[0]
    n_steps = len(episode.rewards)
    ended, cut = np.zeros(n_steps, bool), np.zeros(n_steps, bool)
    ended[-1] = True
    assert steps_of(replace(episode, terminations=ended), DISCOUNT) == n_steps
    assert steps_of(replace(episode, terminations=cut), DISCOUNT) == n_steps - 4
    monkeypatch.setattr(bench_advantages, "N_UPDATES", 200)
    monkeypatch.setattr(bench_advantages, "REST", 1.0)  # episodes of the tiny dataset are short
    row = measure(str(data), tmp_path / "runs")
    assert len(row) == len(HEAD)
    assert -1.0 <= float(row[1]) <= 1.0
