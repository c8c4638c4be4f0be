"""The commands that push, pull and choose remotes."""

import shutil
from pathlib import Path

import pytest

from swarmdata.runtime import own_components
from tests.cli.conftest import ID
from tests.support.command_line import run


@pytest.fixture
def address(tmp_path: Path) -> str:
    (tmp_path / "remote").mkdir()
    return f"file://{tmp_path}/remote"


@pytest.mark.slow
def test_push_and_pull(
    dataset: Path, address: str, cache_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert f"{ID} is published at {address}/{ID}" in run("push", str(dataset), address)
    assert run("remote", "list", address) == f"{ID}\n"

    monkeypatch.setenv("SWARMDATA_REMOTES", address)
    shown = run("pull", ID)
    assert str(cache_folder / "datasets" / ID) in shown
    assert f"from {address}/{ID}" in shown
    assert (cache_folder / "datasets" / ID / "card.md").exists()
    assert "another" not in run("pull", ID)
    assert f"from {address}/{ID}" in run("pull", ID.removesuffix("-v0"))
    assert "is published at" in run("push", ID, address)


@pytest.mark.slow
def test_pull_from_somewhere_to_somewhere(dataset: Path, address: str, tmp_path: Path) -> None:
    run("push", str(dataset), address)
    run("pull", ID, "--from", address, "--out", str(tmp_path / "here"))
    run("pull", f"{address}/{ID}", "--out", str(tmp_path / "there"))
    assert (tmp_path / "here" / "manifest.json").exists()
    assert (tmp_path / "there" / "manifest.json").exists()
    assert "--from" in run("pull", f"{address}/{ID}", "--from", address, code=2)


def test_what_is_nowhere(address: str, monkeypatch: pytest.MonkeyPatch) -> None:
    assert "swarmdata remote add" in run("pull", "coop_nav-medium", code=1)
    shown = run("pull", "coop_nav-medium", "--from", address, code=1)
    assert f"no remote has coop_nav-medium-v1 (asked: {address})" in shown
    shown = run("pull", f"{address}/coop_nav-nothing-v0", code=1)
    assert f"swarmdata remote list {address}" in shown
    monkeypatch.setenv("SWARMDATA_REMOTES", f"file:///nowhere,lost://here,{address}")
    monkeypatch.setitem(own_components._here["remotes"], "lost", "lost:Lost")
    shown = run("pull", ID, code=1)
    assert shown.count("there is no folder /nowhere") == shown.count("'lost:Lost' cannot") == 2


def test_the_gate_is_shut(dataset: Path, address: str, tmp_path: Path) -> None:
    bare = shutil.copytree(dataset, tmp_path / ID, ignore=shutil.ignore_patterns("card.md"))
    shown = run("push", str(bare), address, code=1)
    assert "GateError" in shown
    assert "there is no card.md" in shown
    assert run("remote", "list", address) == ""


def test_the_list_of_remotes(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    monkeypatch.delenv("SWARMDATA_REMOTES")
    run("remote", "add", "hf://org")
    run("remote", "add", "file:///b/")
    run("remote", "add", "file:///b", "--first")
    assert run("remote", "list").split() == ["file:///b", "hf://org"]
    run("remote", "remove", "file:///b")
    assert run("remote", "list").split() == ["hf://org"]
    assert "Known: hf://org" in run("remote", "remove", "hf://other", code=1)
    assert "unknown kind of remote" in run("remote", "add", "ftp://x", code=1)
    monkeypatch.setenv("SWARMDATA_REMOTES", "")
    assert "this file is not used" in run("remote", "add", "hf://third")
