"""The command, in this process."""

from pathlib import Path

import pytest

from tests.evaluation.study.conftest import BC, Make
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
