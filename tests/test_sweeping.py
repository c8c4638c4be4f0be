"""Sweeps: the same numbers as an evaluation, resumed after a stop, refused if they say nothing."""

import csv
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("torch", reason="a run is trained")
pytest.importorskip("matplotlib", reason="a sweep has figures")

from swarmdata import sweep_files, sweeping
from swarmdata.errors import CheckpointError, SchemaError, SpecError
from swarmdata.evaluate import evaluate
from swarmdata.learn.run import read_run
from swarmdata.metrics import Reference, metrics_of
from swarmdata.models import with_models
from swarmdata.result_files import load
from swarmdata.spec import TaskSpec
from swarmdata.sweep_axes import Axis, parse_axis
from swarmdata.sweep_estimates import change_of
from swarmdata.sweep_tables import Degradation
from swarmdata.sweeping import sweep
from swarmdata.targets import evaluate_target, find_target
from swarmdata.training import train_offline
from swarmdata.types import EvalResult

DROP = parse_axis("drop=0,0.6", "communication")
NOISE = parse_axis("noise=0..0.2", "observation", 2)
N = 3


@pytest.fixture(scope="module")
def runs(record: Callable[..., Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of runs: `talks` with messages, `silent` without, two seeds each."""
    folder = tmp_path_factory.mktemp("sweep")
    dataset = record(folder / "data", TaskSpec(horizon=12), ("random",))
    settings = {"n_updates": "2", "hidden": "8", "batch_size": "16"}
    for name, communication in (("talks", "lossy-30"), ("silent", None)):
        train_offline(
            "bc", str(dataset), folder / name, n_seeds=2, changes=settings,
            communication=communication, progress=False,
        )  # fmt: skip
    return folder


@pytest.fixture
def without_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures take longer than these sweeps, and have tests of their own."""
    monkeypatch.setattr(sweeping, "plot_degradation", lambda found, out: None)


def run_sweep(names: list[Path], axes: list[Axis], out: Path, **options: Any) -> list[Degradation]:
    return sweep(
        list(map(str, names)), axes, out, **{"n_episodes": N, "progress": False, **options}
    )


@pytest.fixture(scope="module")
def swept(runs: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("swept")
    run_sweep([runs / "talks"], [DROP, NOISE], out)
    return out


def test_a_sweep_leaves_results_tables_and_figures(swept: Path) -> None:
    names = {path.name for path in swept.iterdir()}
    figures = {"communication-drop.png", "observation-noise.png"}
    assert names == {"results", "sweep.csv", "sweep.md"} | figures
    points = ["trained", "communication-drop-0.0", "communication-drop-0.6"]
    points += ["observation-noise-0.2"]  # noise 0 is as trained
    folders = list((swept / "results" / "talks").iterdir())
    assert {folder.name for folder in folders} == set(points)
    assert [len(list(folder.glob("*.json"))) for folder in folders] == [2] * len(points)
    text = (swept / "sweep.md").read_text()
    assert "| talks, drop 0.3 (as trained) | 2 |" in text
    assert "| talks, noise 0 (as trained) | 2 |" in text
    assert f"The same {N} evaluation seeds" in text


@pytest.mark.parametrize(
    ("point", "models"),
    [
        ("trained", {}),
        ("communication-drop-0.6", {"communication": "lossy-60"}),
        ("observation-noise-0.2", {"observation": "state+noise-0.2"}),
    ],
)
def test_a_point_is_what_evaluate_measures(
    swept: Path, runs: Path, point: str, models: dict[str, str]
) -> None:
    target = find_target(str(runs / "talks"), **models)
    files = sorted((swept / "results" / "talks" / point).glob("*.json"))
    for path, measured in zip(files, evaluate_target(target, N, progress=False), strict=True):
        found, expected = load(path).evaluation, measured.evaluation
        assert (found.policy, found.spec_hash) == (expected.policy, expected.spec_hash)
        assert found.seeds.tolist() == expected.seeds.tolist()
        for name, values in expected.metrics.items():
            np.testing.assert_array_equal(found.metrics[name], values)
        assert load(path).spec == target.spec


def test_the_csv_is_tidy(swept: Path) -> None:
    with (swept / "sweep.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert {row["metric"] for row in rows} >= {"return", "success", "clean_success"}
    keys = [(row["parameter"], row["value"], row["policy"], row["metric"]) for row in rows]
    assert len(set(keys)) == len(keys)
    drops = [float(row["value"]) for row in rows if row["metric"] == "return"][:3]
    assert drops == [0.0, 0.3, 0.6]
    for row in rows:
        assert float(row["low"]) <= float(row["estimate"]) <= float(row["high"])
        if row["metric"] == "return_change" and row["as_trained"] == "1":
            assert float(row["estimate"]) == 0.0


@pytest.mark.usefixtures("without_figures")
def test_a_stopped_sweep_goes_on_where_it_was(
    runs: Path, swept: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls: list[str] = []

    def counted(*arguments: Any, **options: Any) -> EvalResult:
        if len(calls) == 3:
            raise KeyboardInterrupt
        calls.append(options["name"])
        return evaluate(*arguments, **options)

    monkeypatch.setattr(sweep_files, "evaluate", counted)
    with pytest.raises(KeyboardInterrupt):
        run_sweep([runs / "talks"], [DROP, NOISE], tmp_path)
    assert len(list(tmp_path.rglob("*.json"))) == 3
    assert not (tmp_path / "sweep.csv").exists()

    calls.clear()
    calls.extend(["before"] * 4)  # no more interrupts
    run_sweep([runs / "talks"], [DROP, NOISE], tmp_path)
    assert len(calls) - 4 == 8 - 3
    for path in (path for path in swept.rglob("*") if path.suffix in {".csv", ".md", ".json"}):
        assert (tmp_path / path.relative_to(swept)).read_bytes() == path.read_bytes()


@pytest.mark.usefixtures("without_figures")
def test_more_axes_and_points_join_what_is_there(
    runs: Path, swept: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run_sweep([runs / "talks"], [DROP], tmp_path)
    monkeypatch.setattr(sweep_files, "evaluate", None)  # nothing is left to measure
    (found,) = run_sweep([runs / "talks"], [parse_axis("drop=0.6,0", "communication")], tmp_path)
    assert [point.value for point in found.lines[0].points] == [0.6, 0.3, 0.0]
    assert found.falls


@pytest.mark.usefixtures("without_figures")
def test_results_of_another_sweep_are_refused(runs: Path, tmp_path: Path) -> None:
    run_sweep([runs / "talks"], [NOISE], tmp_path)
    with pytest.raises(SchemaError, match=r"differs in episodes \(3 episodes there, 2 asked for"):
        run_sweep([runs / "talks"], [NOISE], tmp_path, n_episodes=2)
    path = sorted((tmp_path / "results" / "talks" / "trained").glob("*.json"))[0]
    document = json.loads(path.read_text())
    document["provenance"]["content"] = "f" * 64  # trained further since
    path.write_text(json.dumps(document))
    with pytest.raises(SchemaError, match=r"-0.json holds .* differs in content"):
        run_sweep([runs / "talks"], [NOISE], tmp_path)


def test_what_says_nothing_is_refused_before_anything_is_measured(
    runs: Path, tmp_path: Path
) -> None:
    talks, silent = runs / "talks", runs / "silent"
    refusals: list[tuple[list[Path], list[Axis], str]] = [
        ([talks], [], "nothing to sweep"),
        ([talks, silent], [NOISE, DROP], "silent was trained without messages"),
        ([talks], [DROP, parse_axis("drop=0,1", "communication")], "drop is swept twice"),
        ([talks, talks], [NOISE], "called 'talks'"),
        ([Path("scripted")], [NOISE], "does not act on what robots see"),
        ([Path("coop_nav-random")], [NOISE], "does not act on what robots see"),
        ([talks, Path("expert")], [NOISE], "different worlds"),
    ]
    for names, axes, message in refusals:
        with pytest.raises(SpecError, match=message):
            run_sweep(names, axes, tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.usefixtures("without_figures")
def test_teams_with_and_without_messages_share_an_axis_of_observation(
    runs: Path, tmp_path: Path
) -> None:
    (found,) = run_sweep([runs / "talks", runs / "silent"], [NOISE], tmp_path)
    assert [line.label for line in found.lines] == ["talks", "silent"]
    assert [point.value for point in found.lines[1].points] == [0.0, 0.2]


@pytest.mark.usefixtures("without_figures")
def test_a_tier_is_swept_on_the_scale_of_its_task(tmp_path: Path) -> None:
    sight = parse_axis("range=2,1", "observation")
    (found,) = run_sweep([Path("expert")], [sight], tmp_path, n_episodes=1)
    assert "score" in [column.key for column in found.columns]
    (line,) = found.lines
    assert [point.value for point in line.points] == [None, 2.0, 1.0]
    assert line.trained.estimates[found.column("score_change")] == (0.0, 0.0, 0.0)


@pytest.mark.usefixtures("without_figures")
def test_an_actor_critic_trained_on_another_view_is_swept_in_that_view(
    runs: Path, tmp_path: Path
) -> None:
    settings = {"n_updates": "3", "actor_hidden": "8", "critic_hidden": "8", "batch_size": "16"}

    def train(observation: str | None, communication: str | None) -> None:
        train_offline(
            "maddpg_bc", str(runs / "data"), tmp_path / "seen", n_seeds=2, changes=settings,
            observation=observation, communication=communication, progress=False,
        )  # fmt: skip

    train("lidar-8", "lossy-30")
    run, features = read_run(tmp_path / "seen"), 5 + 4 * 8 + 3 * (4 + 3)
    assert run.spec == with_models(TaskSpec(horizon=12), "lidar-8", "lossy-30")
    assert run.observation_size == features
    assert run.view is not None
    with pytest.raises(CheckpointError, match="differs in: view is"):
        train(None, None)

    sight = parse_axis("range=2,1", "observation")
    found = run_sweep([tmp_path / "seen"], [DROP, sight], tmp_path / "out")
    assert [point.value for point in found[0].lines[0].points] == [0.0, 0.3, 0.6]
    assert [(point.value, point.is_trained) for point in found[1].lines[0].points] == [
        (2.0, True),
        (1.0, False),
    ]


def result(returns: list[float]) -> EvalResult:
    blank = {name: np.zeros(len(returns)) for name in metrics_of("coop_nav")}
    seeds = np.arange(len(returns), dtype=np.uint64)
    return EvalResult("bc", "coop_nav", "x", seeds, {**blank, "return": np.array(returns)})


@given(st.integers(1, 4), st.integers(0, 2**32 - 1), st.floats(-20, 20), st.floats(1, 9))
def test_a_change_is_paired(n_runs: int, seed: int, loss: float, span: float) -> None:
    returns = np.random.default_rng(seed).normal(0, 50, (n_runs, 5))
    before = [result(row.tolist()) for row in returns]
    after = [result((row - loss).tolist()) for row in returns]
    np.testing.assert_allclose(change_of(after, before, None), -loss, atol=1e-9)
    score = change_of(after, before, Reference(0.0, span))
    np.testing.assert_allclose(score, -100 * loss / span, atol=1e-7)
    value, low, high = change_of(before, [result([0.0] * 5)] * n_runs, None)
    assert low <= value <= high
