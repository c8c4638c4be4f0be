"""The report of online runs: numbers by hand, and files that other commands read."""

import csv
from pathlib import Path

import pytest

pytest.importorskip("torch", reason="online algorithms need the torch extra")

from swarmdata.errors import SchemaError
from swarmdata.evaluation.results.online_report import read_training, write_online_report
from swarmdata.online_algos.mappo import MAPPOConfig
from swarmdata.online_algos.runs.online_training import describe_run, train_run
from swarmdata.specs.task_spec import TaskSpec
from tests.support.measured import csv_rows

SMALL = MAPPOConfig(n_steps=128, n_copies=4, rollout_steps=8, hidden=8, minibatch=64)


def train(folder: Path, seeds: tuple[int, ...], horizon: int = 20) -> Path:
    run = describe_run(
        "mappo", SMALL, TaskSpec(horizon=horizon), seeds, n_checkpoints=2, n_episodes=2
    )
    return train_run(run, folder)


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two processes' runs with invented figures: seeds 0 and 2 reach 90 %, at 64 and 128 frames."""
    folder = tmp_path_factory.mktemp("runs")
    for seeds in ((0, 1), (2,)):
        run = train(folder / f"seeds-{'-'.join(map(str, seeds))}", seeds)
        change(run / "curve.csv", "success", {("64", "0"): 0.95, ("128", "2"): 0.9}, 0.5)
        change(run / "speed.csv", "seconds", {}, 2.0)
        change(run / "speed.csv", "memory_mb", {("128", "1"): 1500.0}, 700.0)
    return folder


def change(path: Path, name: str, values: dict[tuple[str, str], float], other: float) -> None:
    rows = csv_rows(path.read_text())
    who = "seed" if "seed" in rows[0] else "n_seeds"
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        for row in rows:
            writer.writerow({**row, name: values.get((row["frames"], row[who]), other)})


@pytest.mark.slow
def test_the_table_counts_what_was_reached_and_what_it_cost(runs: Path, tmp_path: Path) -> None:
    table = write_online_report([runs], tmp_path / "out")
    (row,) = table.splitlines()[2:]
    cells = [cell.strip() for cell in row.strip("|").split("|")]
    assert cells[:4] == ["`coop_nav`", "`mappo`", "3", "128"]
    assert cells[4].startswith("63.3 [6.0, 100.0] %")
    assert cells[7] == "2 of 3 (first at 64)"
    assert cells[8] == "0.1 min in 2 processes"
    assert cells[9] == f"{128 * 2 / 4 + 128 * 1 / 4:,.0f}"
    assert cells[10] == "1.5 GB"
    assert (tmp_path / "out" / "table.md").read_text() == table
    assert (tmp_path / "out" / "learning.png").stat().st_size > 10_000
    rows = csv_rows((tmp_path / "out" / "coop_nav-mappo.csv").read_text())
    assert [(row["frames"], row["seed"]) for row in rows] == [
        (f, s) for f in ("64", "128") for s in ("0", "1", "2")
    ]


def test_runs_of_different_tasks_are_not_one_training(tmp_path: Path) -> None:
    train(tmp_path / "seeds-0", (0,))
    (tmp_path / "other").mkdir()  # beside seeds-0, it would be refused
    train(tmp_path / "other" / "seeds-1", (1,), horizon=21).rename(tmp_path / "seeds-1")
    with pytest.raises(SchemaError, match="runs of 2 different tasks"):
        read_training(tmp_path)


def test_two_runs_of_one_algorithm_in_one_task_are_refused(runs: Path, tmp_path: Path) -> None:
    with pytest.raises(SchemaError, match="2 of the runs trained mappo in coop_nav"):
        write_online_report([runs, runs], tmp_path / "out")
    assert not (tmp_path / "out").exists()
