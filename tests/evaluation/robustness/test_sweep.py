"""Sweeps: the same numbers as an evaluation, resumed after a stop, refused if they say nothing."""

import json
import shutil
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("torch", reason="a run is trained")
pytest.importorskip("matplotlib", reason="a sweep has figures")

from swarmdata.errors import ResultsError, SpecError
from swarmdata.evaluation.results import target_evaluation
from swarmdata.evaluation.results.policy_names import find_target
from swarmdata.evaluation.results.result_files import Result
from swarmdata.evaluation.results.result_set import Case, read_results, reference_of
from swarmdata.evaluation.results.result_tables import case_table
from swarmdata.evaluation.results.target_evaluation import evaluate_target
from swarmdata.evaluation.robustness.sweep import SWEEP, plan_sweep, run_sweep
from swarmdata.evaluation.robustness.sweep_axes import Axis, parse_axis
from swarmdata.evaluation.robustness.sweep_tables import Degradation, change_of, estimates_of
from swarmdata.evaluation.runs.train import train
from swarmdata.interop.exported_policies import export_policy
from swarmdata.registry.published import Reference
from swarmdata.rollouts.evaluate import evaluate
from swarmdata.specs.task_spec import Robot, Role, TaskSpec
from swarmdata.types import Double, EvalResult
from tests.support.at_once import run_at_once
from tests.support.command_line import run
from tests.support.drawn import save_empty_figures
from tests.support.measured import COOP_NAV as SPEC
from tests.support.measured import csv_rows, result

DROP = parse_axis("drop=0,0.6", "communication")
NOISE = parse_axis("noise=0..0.2", "observation", 2)
N = 3


def train_run(
    out: Path, dataset: Path, communication: str | None = None, n_updates: str = "2"
) -> None:
    settings = {"n_updates": n_updates, "hidden": "8", "batch_size": "16"}
    train(
        "bc", str(dataset), out, n_seeds=2, changes=settings, communication=communication,
        progress=False,
    )  # fmt: skip


@pytest.fixture(scope="module")
def runs(record: Callable[..., Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of runs: `talks` with messages, `silent` without, two seeds each."""
    folder = tmp_path_factory.mktemp("sweep")
    dataset = record(folder / "data", TaskSpec(horizon=12), ("random",))
    for name, communication in (("talks", "lossy-30"), ("silent", None)):
        train_run(folder / name, dataset, communication)
    return folder


def swept_to(out: Path, names: list[Path], axes: list[Axis], **options: Any) -> list[Degradation]:
    planned = plan_sweep(list(map(str, names)), axes, out, **{"n_episodes": N, **options})
    return run_sweep(planned, progress=False)


@pytest.fixture(scope="module")
def swept(runs: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("swept")
    with pytest.MonkeyPatch.context() as patch:
        save_empty_figures(patch)  # `tests/contract/test_task_uses.py` draws some
        swept_to(out, [runs / "talks"], [DROP, NOISE])
    return out


def test_a_sweep_leaves_results_tables_and_figures(swept: Path) -> None:
    names = {path.name for path in swept.iterdir()}
    figures = {"communication-drop.png", "observation-noise.png"}
    figures |= {name.replace(".png", ".pdf") for name in figures}
    assert names == {SWEEP.list_file, "results", "sweep.csv", "sweep.md"} | figures
    points = ["trained", "communication-drop-0.0", "communication-drop-0.6"]
    points += ["observation-noise-0.2"]  # noise 0 is as trained
    folders = {path.name: path for path in (swept / "results").iterdir()}
    assert folders.keys() == set(points)
    assert {len(list(folder.iterdir())) for folder in folders.values()} == {2}
    text = (swept / "sweep.md").read_text()
    assert "| talks, drop 0.3 (as trained) | 2 |" in text
    assert "| talks, noise 0 (as trained) | 2 |" in text
    assert f"the same {N} evaluation seeds" in text
    rows = [row for row in csv_rows((swept / "sweep.csv").read_text()) if row["metric"] == "return"]
    assert [row["value"] for row in rows] == ["0.0", "0.3", "0.6", "0.0", "0.2"]


@pytest.mark.usefixtures("empty_figures")
def test_figures_of_axes_that_are_no_longer_swept_go(runs: Path, tmp_path: Path) -> None:
    for axes in ([DROP, NOISE], [DROP]):
        swept_to(tmp_path, [runs / "talks"], axes, n_episodes=1)
    assert {path.stem for path in tmp_path.glob("*.png")} == {"communication-drop"}
    assert (tmp_path / "results" / "observation-noise-0.2").exists()


def test_a_point_is_what_evaluate_measures(swept: Path, runs: Path, tmp_path: Path) -> None:
    point = "communication-drop-0.6"
    target = find_target(str(runs / "talks"), communication="lossy-60")
    out = tmp_path / "results" / point
    evaluate_target(target, N, out, progress=False)
    for path in out.iterdir():
        assert (swept / "results" / point / path.name).read_bytes() == path.read_bytes()
    (case,) = read_results([swept / "results" / point]).cases  # fit for `swarmdata report`
    assert case.spec == target.spec
    assert len(case.runs["talks"]) == 2


def content(folder: Path) -> dict[str, bytes]:
    """Every file of a sweep but figures, by its path."""
    files = (path for path in folder.rglob("*") if path.suffix in {".csv", ".md", ".json"})
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


@pytest.mark.usefixtures("empty_figures")
def test_a_stopped_sweep_goes_on_where_it_was(
    runs: Path, swept: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls: list[str] = []

    def counted(*arguments: Any, **options: Any) -> EvalResult:
        if len(calls) == 3:
            raise KeyboardInterrupt
        calls.append(options["name"])
        return evaluate(*arguments, **options)

    monkeypatch.setattr(target_evaluation, "evaluate", counted)
    with pytest.raises(KeyboardInterrupt):
        swept_to(tmp_path, [runs / "talks"], [DROP, NOISE])
    assert len(list(tmp_path.rglob("*.json"))) == 3
    assert not (tmp_path / "sweep.csv").exists()

    calls.clear()
    calls.extend(["before"] * 4)  # no more interrupts
    swept_to(tmp_path, [runs / "talks"], [DROP, NOISE])
    assert len(calls) - 4 == 8 - 3
    assert content(tmp_path) == content(swept)


@pytest.mark.slow
def test_points_are_run_by_schedulers_in_any_order_and_at_once(
    runs: Path, swept: Path, tmp_path: Path
) -> None:
    out = tmp_path
    line = (
        "sweep", str(runs / "talks"), "--communication", "drop=0,0.6", "--observation",
        "noise=0..0.2", "--values", "2", "--episodes", str(N), "--out", str(out),
    )  # fmt: skip

    command = partial(run, *line)
    rows = [json.loads(text) for text in command("--points", "--json").splitlines()]
    assert [row["point"] for row in rows] == [
        "talks/trained", "talks/communication-drop-0.0", "talks/communication-drop-0.6",
        "talks/observation-noise-0.2",
    ]  # fmt: skip
    assert {(row["done"], row["policies"]) for row in rows} == {(False, 2)}
    assert not list(out.iterdir())
    assert "unknown point 'talks/drop'" in command("--point", "talks/drop", code=1)

    last = ("--point", rows[-1]["point"])
    first, second = run_at_once((*line, *last), (*line, *last))
    assert first.startswith("talks/observation-noise-0.2: ")
    assert command(*last) == "talks/observation-noise-0.2: was done before\n"
    assert command("--points").splitlines()[-1] == "done  talks/observation-noise-0.2"
    assert second.startswith("talks/observation-noise-0.2: ")
    assert "no result of policy 0 of talks" in command("--collect", code=1)
    for row in rows[:-1]:
        assert command("--point", row["point"]) == f"{row['point']}: done\n"
    assert "| talks, noise 0 (as trained) |" in command("--collect")
    assert content(out) == content(swept)


@pytest.mark.slow
@pytest.mark.usefixtures("empty_figures")
def test_a_run_on_another_dataset_or_view_is_another_line(runs: Path, tmp_path: Path) -> None:
    train_run(tmp_path / "silent", runs / "data", "lossy-30")
    (found,) = swept_to(tmp_path / "out", [runs / "silent", tmp_path / "silent"], [NOISE])
    recorded, view = (line.label for line in found.lines)
    assert recorded == "silent on coop_nav-small-v0"
    assert view.startswith("silent on coop_nav-small-v0@")

    again = shutil.copytree(runs / "silent", tmp_path / "again" / "silent")
    with pytest.raises(
        SpecError, match="two of the teams are called 'silent' on coop_nav-small-v0"
    ):
        swept_to(tmp_path / "none", [runs / "silent", again], [NOISE])
    with pytest.raises(ResultsError, match="two runs have the label 'silent'"):
        swept_to(tmp_path / "out", [again], [NOISE])


def test_a_policy_of_another_library_is_swept(runs: Path, tmp_path: Path) -> None:
    pytest.importorskip("onnxruntime", reason="a file of ONNX acts")
    file = export_policy(str(runs / "silent"), tmp_path / "theirs.onnx")
    planned = plan_sweep([str(file)], [NOISE], tmp_path / "out", n_episodes=N)
    assert [*planned.points()] == ["theirs/trained", "theirs/observation-noise-0.2"]


def test_what_says_nothing_is_refused_before_anything_is_measured(
    runs: Path, tmp_path: Path
) -> None:
    talks, silent = runs / "talks", runs / "silent"
    refusals: list[tuple[list[Path], list[Axis], str]] = [
        ([talks], [], "nothing to sweep"),
        ([talks, silent], [NOISE, DROP], "silent was trained without messages"),
        ([talks], [DROP, parse_axis("drop=0,1", "communication")], "drop is swept twice"),
        ([talks, talks], [NOISE], "called 'talks' on coop_nav-small-v0"),
        ([Path("expert"), Path("expert")], [NOISE], "called 'expert', so"),
        ([Path("scripted")], [NOISE], "does not use observations or messages"),
        ([Path("coop_nav-random")], [NOISE], "does not use observations or messages"),
        ([talks, Path("expert")], [NOISE], "different worlds"),
    ]
    for names, axes, message in refusals:
        with pytest.raises(SpecError, match=message):
            swept_to(tmp_path / "out", names, axes)
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
@pytest.mark.usefixtures("empty_figures")
def test_a_tier_is_swept_on_the_scale_of_its_task(tmp_path: Path) -> None:
    sight = parse_axis("range=2,1", "observation")
    (found,) = swept_to(tmp_path, [Path("expert")], [sight], n_episodes=2)
    assert found.as_trained
    assert "score" in [column.key for column in found.columns]
    (line,) = found.lines
    assert [point.value for point in line.points] == [None, 2.0, 1.0]
    assert line.trained.estimates[found.column("score_change")] == (0.0, 0.0, 0.0)


@pytest.mark.usefixtures("empty_figures")
def test_another_simulator_is_not_called_that_of_training(tmp_path: Path) -> None:
    delay = parse_axis("command_delay=0,1", "body")
    (found,) = swept_to(tmp_path, [Path("expert")], [delay], n_episodes=2, backend="kinematic")
    assert not found.as_trained


def with_returns(returns: Double) -> list[Result]:
    """A result per run, of returns [runs, episodes]."""
    found = [result(index=k, spec=SPEC, n=len(row)) for k, row in enumerate(returns)]
    for each, row in zip(found, returns, strict=True):
        each.evaluation.metrics["return"][:] = row
    return found


@given(st.integers(1, 4), st.integers(0, 2**32 - 1), st.floats(-20, 20), st.floats(1, 9))
def test_a_change_is_paired(n_runs: int, seed: int, loss: float, span: float) -> None:
    returns = np.random.default_rng(seed).normal(0, 50, (n_runs, 5))
    before, after = with_returns(returns), with_returns(returns - loss)
    np.testing.assert_allclose(change_of(after, before, None), -loss, atol=1e-9)
    score = change_of(after, before, Reference(0.0, span))
    np.testing.assert_allclose(score, -100 * loss / span, atol=1e-7)
    value, low, high = change_of(before, with_returns(np.zeros((n_runs, 5))), None)
    assert low <= value <= high


def test_estimates_are_those_of_the_table_of_a_case_on_the_scale_of_training() -> None:
    cut = SPEC.with_updates(team=(Role(robot=Robot(sensor_range=0.5)),))
    assert reference_of(cut) is None
    runs = [result(index=k, spec=cut) for k in range(3)]
    columns, estimates = estimates_of(runs, runs, cut, SPEC)
    table = case_table(Case(None, cut, reference_of(SPEC), None, {"bc": tuple(runs)}))
    assert columns[:-1] == table.columns
    np.testing.assert_array_equal(estimates[:-1], table.rows[0].estimates)
    assert (columns[0].key, columns[-1].key) == ("score", "score_change")
    assert estimates[-1] == (0.0, 0.0, 0.0)
