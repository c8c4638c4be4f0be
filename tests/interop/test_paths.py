"""`swarmdata convert` takes relative and absolute paths and `~`, with every format, both ways."""

import os
import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner

from swarmdata.cli.main import app
from swarmdata.datasets.dataset import Dataset
from swarmdata.interop.formats import FORMATS, find_format

NEEDS = {
    "lerobot": "pyarrow",
    "mcap": "rosbags",
    "minari": "minari",
    "parquet": "pyarrow",
    "rosbag2": "rosbags",
    "torchrl": "torchrl",
    "vault": "flashbax.vault",
}
"""The library of a format, if it is an extra."""

SLOW = ("torchrl", "vault")

PLACES = ("{name}", "./{name}", "below/{name}", "../beside/{name}", "{work}/{name}", "~/{name}")

CASES = [
    pytest.param(name, place, marks=[pytest.mark.slow] if name in SLOW or (k - turn) % 3 else [])
    for k, name in enumerate(FORMATS)
    for turn, place in enumerate(PLACES)
]
"""By default, each format is at two places in turn."""


@pytest.mark.parametrize(("name", "place"), CASES)
def test_every_path_is_understood(
    name: str, place: str, ours: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The source is where it was said to be, and so is the result; nothing lies anywhere else."""
    pytest.importorskip(NEEDS.get(name, "numpy"), reason=f"the extra of {name}")
    for folder in ("home", "work/below", "beside"):
        (tmp_path / folder).mkdir(parents=True)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.chdir(tmp_path / "work")
    kind, at = find_format(name), Place(place, tmp_path)
    shutil.copytree(ours.path, at.path("source"))
    out = convert(at.text("source"), at.text(ours.id), "--to", name)
    assert os.path.normpath(out) == str(at.path(ours.id))
    assert at.path(ours.id).exists()
    made = {"source", ours.id}
    if kind.read is not None:
        out = convert(at.text(ours.id), at.text("read"), "--from", name,
                      "--id", "coop_nav-again-v0")  # fmt: skip
        assert os.path.normpath(out.splitlines()[0]) == str(at.path("read"))
        assert len(Dataset.open(at.path("read"))) > 0
        made.add("read")
    folders = [tmp_path / each for each in ("home", "work", "work/below", "beside")]
    found = {path for folder in folders for path in folder.iterdir()}
    assert found - {tmp_path / "work/below"} <= {at.path(each) for each in made}


def test_the_home_of_nobody_is_one_sentence() -> None:
    result = CliRunner().invoke(app, ["convert", "~nobody-here/data", "out", "--to", "d4rl"])
    assert result.exit_code == 1
    assert result.output == (
        "ConversionError: '~nobody-here/data': '~nobody-here' is no home folder of this machine. "
        "Write the whole path, or './~nobody-here' for a folder of that name.\n"
    )


class Place:
    """Where files are: as the user writes it, and where that is."""

    def __init__(self, pattern: str, folder: Path) -> None:
        self._pattern, self._folder = pattern, folder

    def text(self, name: str) -> str:
        return self._pattern.format(name=name, work=self._folder / "work")

    def path(self, name: str) -> Path:
        text = self.text(name).replace("~", str(self._folder / "home"))
        return Path(os.path.normpath(self._folder / "work" / text))


def convert(*arguments: str) -> str:
    result = CliRunner().invoke(app, ["convert", *arguments])
    assert result.exit_code == 0, (result.output, result.exception)
    return result.stdout.strip()
