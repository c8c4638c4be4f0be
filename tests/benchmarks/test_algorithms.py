"""What the comparison of algorithms keeps, estimates and prints."""

import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("torch")

from swarmdata.offline_algos.maddpg_bc import MADDPGBCConfig
from swarmdata.registry.published import Reference
from swarmdata.rollouts.score_statistics import Estimate
from tests.benchmarks import bench_algorithms
from tests.benchmarks.bench_algorithms import (
    METRICS,
    Kept,
    main,
    our_config,
    rows_of,
    text,
    train_ours,
    verdict,
)
from tests.benchmarks.peers.team_data import Budget, TeamData

BUDGET = Budget(n_updates=100, batch_size=8, units=16, n_seeds=2, n_episodes=5)


def metrics_of(value: float) -> dict[str, np.ndarray]:
    return {name: np.full(BUDGET.n_episodes, value) for name in METRICS}


@pytest.mark.parametrize(
    ("low", "high", "better"), [(1.0, 2.0, "ours"), (-2.0, -1.0, "theirs"), (-1.0, 1.0, "—")]
)
def test_only_an_interval_without_zero_decides(low: float, high: float, better: str) -> None:
    assert verdict(Estimate((low + high) / 2, low, high)) == better


def test_only_complete_runs_with_as_many_episodes_count(tmp_path: Path) -> None:
    kept = Kept(tmp_path)
    kept.write("a, b", 0, metrics_of(1.0), 3.0)
    assert kept.read("a, b", BUDGET) is None
    kept.write("a, b", 1, metrics_of(2.0), 5.0)
    played = kept.read("a, b", BUDGET)
    assert played is not None
    assert played.seconds == 4.0
    assert played.metrics["success"].tolist() == [[1.0] * 5, [2.0] * 5]
    assert kept.read("a, b", replace(BUDGET, n_episodes=6)) is None


def test_a_smaller_budget_keeps_the_share_of_the_warm_up() -> None:
    default = MADDPGBCConfig()
    config = our_config("maddpg_bc", BUDGET)
    assert isinstance(config, MADDPGBCConfig)
    share = default.bc_warmup_updates / default.n_updates
    assert config.bc_warmup_updates == round(share * BUDGET.n_updates)
    assert (config.batch_size, config.actor_hidden) == (8, (16, 16))


def test_rows_have_what_was_kept_and_what_was_recorded(
    tmp_path: Path, tiny: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    data, kept = TeamData(str(tiny)), Kept(tmp_path)
    with pytest.raises(ValueError, match="no references were measured in its task"):
        rows_of(data, kept, BUDGET)
    known = SimpleNamespace(reference=Reference(no_skill=0.0, expert=2.0))
    monkeypatch.setattr(bench_algorithms, "references_of", lambda _: known)
    for seed in range(BUDGET.n_seeds):
        kept.write("OMAR", seed, metrics_of(0.0), 3.0)
        kept.write("omar", seed, metrics_of(1.0), 3.0)
    rows = rows_of(data, kept, BUDGET)
    assert [row[0] for row in rows] == ["recorded episodes", "OMAR", "ours, `omar`"]
    assert rows[1][:3] == ("OMAR", "0.0 (0.0 to 0.0)", "0 0")
    assert rows[1][6:9] == ("`omar`", "+50.0 (+50.0 to +50.0)", "ours")
    page = text(BUDGET, {"omar": "0e52ad6"}, {"tiny": rows})
    assert "ling-pan/OMAR (0e52ad6)" in page
    assert page.count("\n| ") == 2 + len(rows)


@pytest.mark.slow
def test_ours_is_trained_once_at_the_budget(tmp_path: Path, tiny: Path) -> None:
    data, kept = TeamData(str(tiny)), Kept(tmp_path)
    budget = Budget(n_updates=10, batch_size=8, units=8, n_seeds=2, n_episodes=3)
    train_ours("maddpg_bc", data, budget, kept)
    played = kept.read("maddpg_bc", budget)
    assert played is not None
    assert played.metrics["return"].shape == (2, 3)
    written = kept.path("maddpg_bc", 0).stat().st_mtime_ns
    train_ours("maddpg_bc", data, budget, kept)
    assert kept.path("maddpg_bc", 0).stat().st_mtime_ns == written


def test_without_checkouts_nothing_is_measured(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["bench_algorithms"])
    for name in ("CORL", "OMAR", "OG_MARL"):
        monkeypatch.delenv(name, raising=False)
    main()
    assert capsys.readouterr().out.count("\n") == 1
