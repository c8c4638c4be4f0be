"""`swarmdata convert` takes relative and absolute paths and `~`, both ways."""

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import CliRunner

from swarmdata.cli.main import app
from swarmdata.datasets.dataset import Dataset
from tests.support.command_line import run

PLACES = ("{name}", "./{name}", "below/{name}", "../beside/{name}", "{work}/{name}", "~/{name}")

CASES = [(("d4rl", "numpy")[k % 2], place) for k, place in enumerate(PLACES)]
"""A file and a folder: whatever the format, paths are read before its module gets them."""


@pytest.mark.parametrize(("format", "place"), CASES)
def test_every_path_is_understood(
    format: str, place: str, ours: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The source is where it was said to be, and so is the result; nothing lies anywhere else."""
    for folder in ("home", "work/below", "beside"):
        (tmp_path / folder).mkdir(parents=True)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.chdir(tmp_path / "work")

    def text(name: str) -> str:
        return place.format(name=name, work=tmp_path / "work")

    def path(name: str) -> Path:
        there = text(name).replace("~", str(tmp_path / "home"))
        return Path(os.path.normpath(tmp_path / "work" / there))

    shutil.copytree(ours.path, path("source"))
    assert os.path.normpath(convert("source", ours.id, text, "--to", format)) == str(path(ours.id))
    out = convert(ours.id, "read", text, "--from", format, "--id", "coop_nav-again-v0")
    assert os.path.normpath(out.splitlines()[0]) == str(path("read"))
    assert len(Dataset.open(path("read"))) > 0
    folders = [tmp_path / each for each in ("home", "work", "work/below", "beside")]
    found = {each for folder in folders for each in folder.iterdir()} - {tmp_path / "work/below"}
    assert found == {path(name) for name in ("source", ours.id, "read")}


def convert(source: str, target: str, text: Callable[[str], str], *options: str) -> str:
    result = CliRunner().invoke(app, ["convert", text(source), text(target), *options])
    assert result.exit_code == 0, (result.output, result.exception)
    return result.stdout.strip()


def test_the_home_of_nobody_is_one_sentence() -> None:
    result = run("convert", "~nobody-here/data", "out", "--to", "d4rl", code=1)
    assert "'~nobody-here' is no home folder of this machine" in result
