"""What the comparison of memories trains, keeps and prints, and one small measurement."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch", reason="training needs the torch extra")

from swarmdata.learn.memory.memory_settings import MemorySettings
from swarmdata.registry.published import Reference
from tests.benchmarks import bench_memory
from tests.benchmarks.bench_algorithms import METRICS, Kept, Played
from tests.benchmarks.bench_memory import (
    ALGORITHMS,
    MEMORIES,
    VIEWS,
    Row,
    config_of,
    main,
    models_of,
    read,
    smaller,
    text,
)
from tests.benchmarks.peers.team_data import Budget
from tests.support.one_process import use_one_process

BUDGET = Budget(n_updates=10, batch_size=40, units=8, n_seeds=2, n_episodes=4)


@pytest.fixture
def known(monkeypatch: pytest.MonkeyPatch) -> None:
    """A return of 2 is a score of 100 in every task."""
    reference = Reference(no_skill=0.0, expert=2.0)
    monkeypatch.setattr(bench_memory, "scores_of", lambda _, played: scores(played, reference))


def scores(played: Played, reference: Reference) -> np.ndarray:
    return 100 * played.metrics["return"] / reference.expert


def played(returns: float, seconds: float = 3.0) -> Played:
    """Returns that every seed has in every episode; a hundredth of them are successes."""
    shape = (BUDGET.n_seeds, BUDGET.n_episodes)
    return Played({name: np.full(shape, returns) for name in METRICS}, seconds)


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_rows_differ_in_memory_alone(algorithm: str) -> None:
    view = VIEWS["goal-for-10"]
    present, stacked, gru = (config_of(Row(algorithm, memory), view, BUDGET) for memory in MEMORIES)
    assert stacked == present  # it is in the observations
    assert isinstance(gru, MemorySettings)
    assert (gru.memory, gru.burn_in) == ("gru", 60)
    assert replace(gru, memory="none", burn_in=10) == present
    assert present.n_updates == 10  # type: ignore[attr-defined]
    for name in ("hidden", "actor_hidden", "critic_hidden", "flow_hidden"):
        assert getattr(present, name, (8, 8)) == (8, 8)


def test_four_steps_are_sensed_and_heard() -> None:
    assert models_of(VIEWS["lidar-16"], "gru") == ("lidar-16", "none")
    assert models_of(VIEWS["lidar-16"], "stack-4") == ("lidar-16+stack-4", "none")
    expected = "state+goal-for-0+stack-4", "errand+lossy-60+expires-3"
    assert models_of(VIEWS["errand-lossy-60"], "stack-4") == expected


@pytest.mark.usefixtures("known")
def test_a_memory_is_compared_with_the_present_of_its_algorithm() -> None:
    found = {
        "lidar-16": {Row("bc", "present"): played(1.0), Row("bc", "gru"): played(1.5, 9.0)},
        "bearing": {Row("bc", "present"): played(0.5), Row("iql", "stack-4"): played(1.0)},
    }
    page = text(BUDGET, 200, found)
    lines = [line for line in page.splitlines() if line.startswith("| `")]
    assert lines == [
        "| `bc` | present | 50.0 (50.0 to 50.0) | 25.0 (25.0 to 25.0) |",
        "| `bc` | `gru` | 75.0: **+25.0 (+25.0 to +25.0)** |  |",
        "| `iql` | `stack-4` |  | 50.0 (50.0 to 50.0) |",
        "| `bc` | present | 100 / 100 | 50 / 50 | 3 |",
        "| `bc` | `gru` | 150 / 150 |  | 9 |",
        "| `iql` | `stack-4` |  | 100 / 100 | 3 |",
    ]
    assert "from 200 recorded steps" in page
    assert "`lidar-16`: `coop_nav-expert` seen with `lidar-16`; `bearing`:" in page


def test_only_complete_rows_are_read(tmp_path: Path) -> None:
    kept = Kept(tmp_path / "bearing")
    for seed in range(BUDGET.n_seeds):
        kept.write("bc-gru", seed, {name: np.zeros(BUDGET.n_episodes) for name in METRICS}, 1.0)
    kept.write("bc-present", 0, {name: np.zeros(BUDGET.n_episodes) for name in METRICS}, 1.0)
    assert {name: set(rows) for name, rows in read(tmp_path, BUDGET).items()} == {
        "bearing": {Row("bc", "gru")}
    }


def test_a_dataset_is_cut_once_and_never_grows(tmp_path: Path, tiny: Path) -> None:
    assert smaller(str(tiny), 10_000, tmp_path).n_steps < 10_000
    data = smaller(str(tiny), 100, tmp_path / "data")
    assert 100 <= data.n_steps < smaller(str(tiny), 10_000, tmp_path).n_steps


@pytest.mark.slow
@pytest.mark.usefixtures("known")
def test_every_memory_is_trained_once_in_a_view(
    tmp_path: Path, tiny: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    use_one_process(monkeypatch)
    view = VIEWS["errand-lossy-60"]._replace(dataset=str(tiny))
    monkeypatch.setitem(VIEWS, "bearing", view)
    small = "--updates 4 --batch 40 --units 8 --seeds 2 --episodes 2 --steps 300"
    arguments = ["--views", "bearing", "--algorithms", "bc", "mac_flow", *small.split()]
    arguments += ["--out", str(tmp_path / "out"), "--only-print"]
    main(arguments)
    first = capsys.readouterr().out
    rows = [line.split(" | ")[:2] for line in first.splitlines() if line.startswith("| `")]
    assert len(rows) == 2 * 2 * len(MEMORIES)
    main([*arguments, "--only-kept"])
    assert capsys.readouterr().out == first[first.index("Policies of the present") :]
