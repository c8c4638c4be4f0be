"""Evaluations as jobs: the same files from any engine, twice, at once, and in pieces."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from swarmdata.errors import BuildError, ResultsError
from swarmdata.evaluation.results.evaluation_jobs import (
    Evaluation,
    TargetName,
    collect_evaluations,
    evaluations_of,
    evaluator,
    run_evaluations,
)
from tests.support.at_once import run_at_once
from tests.support.command_line import run
from tests.support.tiny import abandoned

N = 2


def evaluations(out: Path, *names: str) -> list[Evaluation]:
    sources = [TargetName(name=name) for name in names or ("expert", "scripted")]
    return [each for source in sources for each in evaluations_of(source, source.find(), N, out)]


def files(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.glob("*.json")}


@pytest.fixture(scope="module")
def alone(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("alone")
    assert run_evaluations(evaluations(out), progress=False) == 0
    return out


@pytest.mark.slow
def test_processes_leave_the_files_of_one_process(alone: Path, tmp_path: Path) -> None:
    every = evaluations(tmp_path)
    run_evaluations(every, workers=2, progress=False)
    assert len(files(tmp_path)) == len(every) > 2
    assert files(tmp_path) == files(alone)


@pytest.mark.slow
def test_two_commands_at_once_leave_the_same_files(alone: Path, tmp_path: Path) -> None:
    command = ("evaluate", "expert", "scripted", "--episodes", str(N), "--out", tmp_path)
    first, second = run_at_once(command, command)
    assert files(tmp_path) == files(alone)
    assert first.splitlines()[0] == second.splitlines()[0]


def test_parts_are_collected_by_a_command_that_evaluates_nothing(
    alone: Path, tmp_path: Path
) -> None:
    line = ("evaluate", "expert", "scripted", "--episodes", N, "--out", tmp_path)
    n = len(evaluations(tmp_path))
    half = n // 2
    assert run(*line, "--part", "2/2") == f"{half} of {n} results made in {tmp_path}\n"
    assert run(*line, "--part", "2/2") == f"0 of {n} results made in {tmp_path}\n"
    assert f"{n - half} of {n} evaluations are not done" in run(*line, "--collect", code=1)
    run(*line, "--part", "1/2")
    assert files(tmp_path) == files(alone)
    assert "expert" in run(*line, "--collect")
    for wrong in ("0/2", "3/2", "2", "a/b"):
        assert "expected K/N" in run(*line, "--part", wrong, code=2)


def test_only_what_is_missing_is_evaluated(alone: Path, tmp_path: Path) -> None:
    for name, content in list(files(alone).items())[1:]:
        (tmp_path / name).write_bytes(content)
    left = abandoned(tmp_path / name)  # of a writer that was killed when its result was there
    every = evaluations(tmp_path)
    assert run_evaluations(every, progress=False) == len(every) - 1
    assert not left.exists()
    assert files(tmp_path) == files(alone)
    assert [each.path is not None for each in collect_evaluations(every)] == [True] * len(every)


def test_results_of_one_name_are_refused_before_any_evaluation(tmp_path: Path) -> None:
    names = ("evaluate", "medium", "expert", "--label", "team", "--episodes", N)
    message = run(*names, "--out", tmp_path / "out", code=1)
    assert "two of the policies would have the result team--" in message
    assert not (tmp_path / "out").exists()


def test_a_process_with_another_policy_refuses(tmp_path: Path) -> None:
    (wanted,) = evaluations(tmp_path, "scripted")
    job = wanted.job(again=False, n_threads=1)
    job.payload["evaluation"]["provenance"]["code_version"] = "0.0.1"
    with pytest.raises(ResultsError, match="scripted has another policy 0 where it is evaluated"):
        evaluator()(job.payload, lambda episodes: None)
    assert not files(tmp_path)


def test_a_failure_elsewhere_names_the_policy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    every = evaluations(tmp_path, "scripted")
    blocked = tmp_path / "file" / "results"
    blocked.parent.write_text("")
    there = [each.model_copy(update={"folder": blocked}) for each in every]
    with (
        ThreadPoolExecutor(1) as elsewhere,
        pytest.raises(BuildError, match="policy 0 of scripted failed: "),
    ):
        run_evaluations(there, engine=elsewhere, progress=False)


def test_a_file_is_found_from_any_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "run").mkdir()
    models = {"observation": {"kind": "state"}, "communication": "lossy-30"}
    name = TargetName.parse({"name": "run", "task": "spec.yaml", **models})
    assert name.name == str(tmp_path / "run")
    assert name.task == str(tmp_path / "spec.yaml")
    assert (name.observation, name.communication) == ({"kind": "state"}, "lossy-30")
    assert TargetName(name="expert", task="coop_nav").task == "coop_nav"
