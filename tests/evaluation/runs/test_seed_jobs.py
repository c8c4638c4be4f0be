"""Seeds in several processes: the same policies as together, in any order, twice, and at once."""

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("torch", reason="runs need the torch extra")

from swarmdata.errors import BuildError, CheckpointError, UnknownNameError
from swarmdata.evaluation.results.policy_names import find_target
from swarmdata.evaluation.results.target_evaluation import evaluate_target
from swarmdata.evaluation.runs.seed_jobs import groups_of
from swarmdata.evaluation.runs.train import train
from swarmdata.learn.training.run_files import group_folder, read_table, run_folders
from swarmdata.learn.training.run_folder import read_run
from swarmdata.rollouts.evaluate import evaluate
from swarmdata.specs.task_spec import TaskSpec
from tests.support.at_once import run_at_once

SETTINGS = {"n_updates": "4", "hidden": "8", "batch_size": "16"}
N_SEEDS = 3


@pytest.fixture(scope="module")
def dataset(record: Callable[..., Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record(tmp_path_factory.mktemp("seeds") / "data", TaskSpec(horizon=12), ("random",))


@pytest.fixture(scope="module")
def together(dataset: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of all seeds in one process."""
    out = tmp_path_factory.mktemp("together") / "bc"
    train_in(out, dataset)
    return out


def train_in(out: Path, dataset: Path, **options: Any) -> Any:
    settings = {"n_seeds": N_SEEDS, "changes": SETTINGS, "curve_every": 2, "progress": False}
    return train("bc", str(dataset), out, **{**settings, **options})


def measured(run: Path) -> list[tuple[Any, ...]]:
    """Every seed and index with all metrics of its policy, bit for bit."""
    return [
        (
            each.provenance.seed,
            each.provenance.index,
            each.provenance.label,
            *(values.tobytes() for values in each.evaluation.metrics.values()),
        )
        for each in evaluate_target(find_target(str(run)), 2, progress=False)
    ]


def losses(run: Path) -> list[dict[str, float]]:
    rows = [row for folder in run_folders(run) for row in read_table(folder / "losses.csv")]
    return sorted(rows, key=lambda row: (row["update"], row["seed"]))


@pytest.mark.slow
def test_processes_train_the_same_policies(together: Path, dataset: Path, tmp_path: Path) -> None:
    found = train_in(tmp_path / "bc", dataset, workers=2)
    assert [folder.name for folder in run_folders(tmp_path / "bc")] == ["seeds-0-1", "seeds-2"]
    assert measured(tmp_path / "bc") == measured(together)
    assert losses(tmp_path / "bc") == losses(together)
    spec = find_target(str(together)).spec
    last = evaluate(found[2], spec, name="last", n_episodes=2, progress=False)
    assert last.metrics["return"].tobytes() == measured(together)[2][3]
    again = train_in(tmp_path / "bc", dataset, workers=2)  # nothing is left to train
    assert len(again) == N_SEEDS


@pytest.mark.slow
def test_parts_may_be_trained_twice_and_at_once(
    together: Path, dataset: Path, tmp_path: Path
) -> None:
    settings = [word for key, value in SETTINGS.items() for word in ("--set", f"{key}={value}")]
    line: tuple[str | Path, ...] = (
        "train", "bc", dataset, "--out", tmp_path / "bc", "--seeds", str(N_SEEDS),
        "--curve-every", "2", *settings,
    )  # fmt: skip
    parts = ("1/2", "2/2", "1/2")
    written = run_at_once(*[(*line, "--part", part) for part in parts])
    assert {text.splitlines()[-1] for text in written} == {f"{tmp_path}/bc"}
    assert measured(tmp_path / "bc") == measured(together)


def test_more_parts_than_seeds_leave_some_without_work(dataset: Path, tmp_path: Path) -> None:
    assert train_in(tmp_path / "bc", dataset, part=(4, 4)) == []
    assert len(train_in(tmp_path / "bc", dataset, part=(3, 4))) == 1
    with pytest.raises(CheckpointError, match=r"trained in parts; name these: .*seeds-2$"):
        read_run(tmp_path / "bc")
    assert [each.name for each in run_folders(tmp_path / "bc")] == ["seeds-2"]


@pytest.mark.slow
def test_seeds_are_not_grouped_twice(together: Path, dataset: Path, tmp_path: Path) -> None:
    with pytest.raises(
        BuildError, match=r"other groups of seeds: it holds a run in .*bc, expected"
    ):
        train_in(together, dataset, workers=2)
    train_in(tmp_path / "bc", dataset, part=(1, 2))
    with pytest.raises(BuildError, match=r"holds a run in .*seeds-0-1, expected .*seeds-0 and so"):
        train_in(tmp_path / "bc", dataset, part=(1, 3))


def test_runs_of_different_trainings_are_no_run(dataset: Path, tmp_path: Path) -> None:
    train_in(tmp_path / "bc", dataset, part=(1, 3))
    other: dict[str, Any] = {"part": (2, 3), "changes": {**SETTINGS, "n_updates": "2"}}
    with pytest.raises(CheckpointError, match=r"seeds-0 holds .* config.n_updates is 4, not 2\."):
        train_in(tmp_path / "bc", dataset, **other)  # before it trains
    assert [each.name for each in run_folders(tmp_path / "bc")] == ["seeds-0"]
    train_in(tmp_path / "other", dataset, **other)
    shutil.copytree(tmp_path / "other", tmp_path / "bc", dirs_exist_ok=True)
    with pytest.raises(CheckpointError, match="are of different trainings"):
        find_target(str(tmp_path / "bc"))


def test_a_wrong_setting_is_refused_before_any_process(dataset: Path, tmp_path: Path) -> None:
    with pytest.raises(UnknownNameError, match="unknown setting"):
        train_in(tmp_path / "bc", dataset, workers=2, changes={"hiden": "8"})
    assert not (tmp_path / "bc").exists()


def test_groups_are_in_the_order_of_seeds(tmp_path: Path) -> None:
    assert groups_of(range(5), "local", 2) == [(0, 1, 2), (3, 4)]
    assert groups_of(range(2), "local", 3) == [(0,), (1,)]
    assert groups_of(range(9, 12), "ray", 1) == [(9,), (10,), (11,)]
    for group in ((9,), (10,), (2, 3)):
        (group_folder(tmp_path, group)).mkdir()
        (group_folder(tmp_path, group) / "config.json").write_text("{}")
    names = [folder.name for folder in run_folders(tmp_path)]
    assert names == ["seeds-2-3", "seeds-9", "seeds-10"]
