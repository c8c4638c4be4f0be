"""The command, in this process and in ones of its own that are killed."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from swarmdata.evaluation.results.result_files import load_result
from swarmdata.evaluation.study.cells.cell_costs import Cost
from swarmdata.evaluation.study.cells.cell_worker import run_cell
from swarmdata.evaluation.study.cells.cells import cells_of
from swarmdata.evaluation.study.cells.study_data import digest_of
from tests.evaluation.study.conftest import BC, MADDPG, Make
from tests.support.command_line import run


@pytest.mark.usefixtures("here", "empty_figures")
def test_the_command_writes_checks_and_refuses(make_study: Make, tmp_path: Path) -> None:
    file, folders = tmp_path / "study.yaml", ("--out", tmp_path / "o", "--work", tmp_path / "w")
    file.write_text(make_study(algorithms={"bc": BC}, seeds=[0]).to_yaml())
    assert str(tmp_path / "o" / "report.md") in run("study", file, *folders)
    assert "are the same" in run("study", file, *folders[2:], "--check", "bc/coop_nav-tiny-v0")
    assert str(tmp_path / "o" / "report.md") in run("study", tmp_path / "o")
    assert "--only: it has no effect" in run("study", tmp_path / "o", "--only", "bc/*", code=2)
    file.write_text(make_study(algorithms={"bc": BC}, seeds=[0], episodes=3).to_yaml())
    assert "--again to delete these cells" in run("study", file, *folders, code=1)
    file.write_text(f"{file.read_text()}seed: 1\n")
    assert "Did you mean 'seeds'" in run("study", file, *folders, code=1)


def start(file: Path, folder: Path) -> "subprocess.Popen[bytes]":
    code = "from swarmdata.cli.main import main; main()"
    options = ["--out", folder / "out", "--work", folder / "work", "--workers", "2"]
    words = [sys.executable, "-c", code, "study", file, *options]
    return subprocess.Popen([str(word) for word in words], env={**os.environ, "PYTHONPATH": "."})


def returns(work: Path) -> dict[str, list[float]]:
    files = sorted(work.glob("cells/*/*/results/*.json"))
    return {file.name: load_result(file).evaluation.metrics["return"].tolist() for file in files}


@pytest.mark.slow
def test_a_study_that_is_killed_goes_on_to_the_same_numbers(
    make_study: Make, tmp_path: Path
) -> None:
    pytest.importorskip("matplotlib", reason="figures need the plots extra")
    algorithms = {"bc": {**BC, "updates": 3000}, "maddpg": {**MADDPG, "updates": 1500}}
    study = make_study(algorithms=algorithms)
    file = tmp_path / "study.yaml"
    file.write_text(study.to_yaml())
    command = start(file, tmp_path)
    deadline = time.monotonic() + 300
    while len(list(tmp_path.glob("work/cells/*/*/*/checkpoint.safetensors"))) < 2:
        assert command.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.05)
    command.send_signal(signal.SIGKILL)
    command.wait()
    assert start(file, tmp_path).wait(timeout=600) == 0
    costs = [Cost.from_file(each) for each in tmp_path.glob("work/cells/*/*/cost.json")]
    assert len(costs) == 2
    for cell in cells_of(study, digest_of):
        run_cell(cell, tmp_path / "whole" / "cells" / cell.label / cell.data)
    assert returns(tmp_path / "work") == returns(tmp_path / "whole")
    assert len(returns(tmp_path / "work")) == 4
