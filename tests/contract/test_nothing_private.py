"""What leaves the house has no word of whose house it was: user, host, home or installation."""

import bz2
import gzip
import lzma
import platform
import socket
import sys
import zipfile
import zlib
from collections.abc import Iterator
from pathlib import Path

import pytest
from platformdirs import user_cache_path

import swarmdata
from swarmdata.cards.card import write_card
from swarmdata.evaluation.study.plan import Study
from tests.catalogue.conftest import little_published
from tests.evaluation.study.conftest import here  # noqa: F401  # a fixture
from tests.support.command_line import run
from tests.support.tiny import TINY, make_tiny

USER, HOST = "ursula_canary", "host-canary"
INSTALLED = (str(Path(swarmdata.__file__).parents[1].resolve()), sys.prefix)


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The home of a user, where everything of theirs is."""
    found = tmp_path / "home" / USER
    found.mkdir(parents=True)
    monkeypatch.setenv("XDG_CACHE_HOME", str(user_cache_path()))  # of compiled kernels
    for name in ("USER", "LOGNAME", "USERNAME"):
        monkeypatch.setenv(name, USER)
    monkeypatch.setenv("HOME", str(found))
    monkeypatch.setenv("HOSTNAME", HOST)
    monkeypatch.setenv("SWARMDATA_CACHE", str(found / "cache"))
    monkeypatch.setenv("SWARMDATA_REMOTES", "")
    monkeypatch.setattr(socket, "gethostname", lambda: HOST)
    monkeypatch.setattr(platform, "node", lambda: HOST)
    monkeypatch.chdir(found)
    return found


def unpacked(path: Path) -> Iterator[bytes]:
    """The bytes of a file, and those of what it packs."""
    content = path.read_bytes()
    yield content
    if zipfile.is_zipfile(path):
        with zipfile.ZipFile(path) as archive:
            yield from map(archive.read, archive.namelist())
    for unpack in (gzip.decompress, bz2.decompress, lzma.decompress, zlib.decompress):
        try:
            yield unpack(content)
        except (OSError, EOFError, lzma.LZMAError, zlib.error):
            continue


def given_away(folder: Path) -> list[str]:
    """Files below a folder, and what each says of the user, the host or the installation."""
    words = [USER, HOST, *INSTALLED]
    return [
        f"{path.relative_to(folder)}: {word}"
        for path in sorted(folder.rglob("*"))
        if path.is_file()
        for content in unpacked(path)
        for word in words
        if word.encode() in content or word in str(path.relative_to(folder))
    ]


@pytest.fixture
def data(home: Path) -> Path:
    folder = make_tiny(home / "data" / TINY.id)
    write_card(folder)
    return folder


def test_a_pushed_dataset_and_its_card(home: Path, data: Path, tmp_path: Path) -> None:
    for name in ("hub", "cards"):
        (tmp_path / name).mkdir()
    run("push", data, f"file://{tmp_path / 'hub'}")
    run("card", data, "--out", tmp_path / "cards")
    for folder in (data, tmp_path / "hub", tmp_path / "cards"):
        assert given_away(folder) == []


@pytest.mark.slow
def test_reports_catalogues_and_exported_policies(home: Path, data: Path, tmp_path: Path) -> None:
    """Their folders are elsewhere, so a path to the runs leads through the user's home."""
    pytest.importorskip("torch", reason="training needs the torch extra")
    changes = ("--set", "n_updates=5", "--set", "hidden=8", "--set", "batch_size=16")
    run("train", "bc", data, "--out", home / "runs" / "bc", "--seeds", 2, *changes)
    run("evaluate", home / "runs" / "bc", "--episodes", 5, "--out", home / "results")
    run("report", home / "results", "--out", tmp_path / "report")
    with little_published():
        options = ("--results", home / "results", "--out", tmp_path / "site")
        run("catalogue", "build", data, *options)
    for name in ("report", "site"):
        assert given_away(tmp_path / name) == []
    assert ">bc</td>" in next((tmp_path / "site/results").glob("result-results-*")).read_text()
    for package in ("onnx", "onnxscript"):
        pytest.importorskip(package, reason="exports a policy")
    (tmp_path / "robot").mkdir()
    run("export-policy", home / "runs" / "bc", tmp_path / "robot" / "policy.onnx")
    assert given_away(tmp_path / "robot") == []


@pytest.mark.slow
@pytest.mark.usefixtures("here")
def test_a_study(home: Path, data: Path, tmp_path: Path) -> None:
    for package in ("torch", "matplotlib"):
        pytest.importorskip(package, reason="runs a study with figures")
    cell = {"algorithm": "bc", "family": "cloning", "updates": 4}
    plan = {"name": "tiny", "datasets": [str(data)], "algorithms": {"bc": cell}, "seeds": [0, 1],
            "hidden": [8], "episodes": 4}  # fmt: skip
    file = home / "study.yaml"
    file.write_text(Study.parse(plan, "the test's study").to_yaml())
    run("study", file, "--out", tmp_path / "study", "--work", home / "work")
    assert given_away(tmp_path / "study") == []
    run("study", tmp_path / "study")  # the pages once more, from what was published
