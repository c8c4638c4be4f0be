"""Public logs are fetched, imported and checked by recipes; here of look-alikes on this machine."""

import hashlib
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

import swarmdata
from swarmdata.cli.main import app
from swarmdata.errors import (
    AbsentFileError,
    ChecksumError,
    ConversionError,
    HubError,
    OutputError,
    SpecError,
    UnknownNameError,
)
from swarmdata.interop.logs import public_logs
from swarmdata.interop.logs.import_logs import shipped_maps
from swarmdata.interop.logs.public_logs import PublicLogs, fetch_logs
from swarmdata.specs.origins.log_origin import ImportedLogs
from tests.hub.remotes.faults import Fault
from tests.hub.remotes.static_host import StaticHost
from tests.interop.logs.test_windows_and_pixels import write_windows
from tests.support.command_line import run

NAME = "alike"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What is published."""
    folder = tmp_path_factory.mktemp("published")
    write_windows(folder / "Train.csv")
    return folder


@pytest.fixture(scope="module")
def digest(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> str:
    out = tmp_path_factory.mktemp("dataset") / "data"
    made = swarmdata.import_logs(folder, out, log_map="retlo-3", id="retlo-alike-v0")
    return made.digest


@pytest.fixture
def host(folder: Path) -> Iterator[StaticHost]:
    with StaticHost(folder) as host:
        yield host


@pytest.fixture(autouse=True)
def recipe(
    host: StaticHost, folder: Path, digest: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> dict[str, Any]:
    """The one recipe that the package has in these tests; changes count."""
    content = (folder / "Train.csv").read_bytes()
    entry = {"size": len(content), "sha256": hashlib.sha256(content).hexdigest()}
    recipe = {
        "title": "a look-alike", "source": "https://example.org/robots", "license": "none stated",
        "citation": "Nobody, 2020", "address": host.url, "map": "retlo-3", "id": "retlo-alike-v0",
        "digest": digest, "files": {"Train.csv": entry},
    }  # fmt: skip
    monkeypatch.setattr(
        public_logs, "public_logs", lambda: {NAME: PublicLogs.parse(recipe, "the recipe")}
    )
    monkeypatch.setenv("SWARMDATA_CACHE", str(tmp_path / "cache"))
    return recipe


def test_logs_are_fetched_once_and_found_by_their_id(
    host: StaticHost, digest: str, tmp_path: Path
) -> None:
    made = fetch_logs(NAME, accept_terms=True)
    assert made.digest == digest
    assert len([line for line in host.log if "Train.csv" in line]) == 1
    assert fetch_logs(NAME, accept_terms=True).path == made.path
    found = swarmdata.load("retlo-alike-v0")
    assert (found.digest, found.path) == (digest, made.path)
    assert isinstance(found.recipe, ImportedLogs)
    assert found.recipe.license == "none stated"
    assert fetch_logs(NAME, tmp_path / "two", accept_terms=True).digest == digest
    assert len(host.log) == 1, "files in the cache are not fetched again"


def test_terms_come_first(host: StaticHost, folder: Path) -> None:
    for source in (None, folder):
        with pytest.raises(SpecError, match=r"(?s)licence: none stated.*Nobody.*accept_terms=True"):
            fetch_logs(NAME, source=source)
    assert not host.log


def test_a_download_that_is_another_one_is_refused(tmp_path: Path) -> None:
    other = tmp_path / "other"
    other.mkdir()
    with pytest.raises(ConversionError, match=r"has no Train\.csv"):
        fetch_logs(NAME, tmp_path / "data", accept_terms=True, source=other)
    with write_windows(other / "Train.csv").open("a") as file:
        file.write("\n")
    with pytest.raises(ChecksumError, match=r"is another file than that.*import .* --map retlo-3"):
        fetch_logs(NAME, tmp_path / "data", accept_terms=True, source=other)
    assert not (tmp_path / "data").exists()


def test_wrong_bytes_of_the_server_are_thrown_away(
    host: StaticHost, tmp_path: Path, recipe: dict[str, Any]
) -> None:
    recipe["files"]["Train.csv"]["sha256"] = "0" * 64
    with pytest.raises(ChecksumError, match=r"wrong bytes of Train\.csv twice"):
        fetch_logs(NAME, tmp_path / "data", accept_terms=True)
    assert not [path for path in tmp_path.rglob("*") if path.name.startswith("Train.csv")]
    assert not (tmp_path / "data").exists()


def test_a_lost_connection_is_resumed(
    host: StaticHost, tmp_path: Path, digest: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    host.faults.append(Fault("Train.csv", cut=1_000, times=1))
    monkeypatch.setattr("swarmdata.hub.remotes.network.backoff.time.sleep", lambda seconds: None)
    assert fetch_logs(NAME, tmp_path / "data", accept_terms=True).digest == digest
    assert len(host.log) == 2


def test_files_that_were_removed(tmp_path: Path, recipe: dict[str, Any]) -> None:
    recipe["address"] += "/elsewhere"
    with pytest.raises(AbsentFileError, match=r"elsewhere, such as https://example\.org/robots"):
        fetch_logs(NAME, tmp_path / "data", accept_terms=True)


def test_the_download_of_a_user_needs_no_network(
    host: StaticHost, tmp_path: Path, folder: Path, digest: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SWARMDATA_OFFLINE", "1")
    with pytest.raises(HubError, match="SWARMDATA_OFFLINE is set"):
        fetch_logs(NAME, tmp_path / "data", accept_terms=True)
    made = fetch_logs(NAME, tmp_path / "data", accept_terms=True, source=folder)
    assert made.digest == digest
    assert not host.log


def test_another_digest_leaves_nothing(
    folder: Path, tmp_path: Path, recipe: dict[str, Any], digest: str
) -> None:
    recipe["digest"] = "1" * 64
    with pytest.raises(ChecksumError, match=f"digest {digest}, expected 1111"):
        fetch_logs(NAME, tmp_path / "data", accept_terms=True, source=folder)
    assert not (tmp_path / "data").exists()
    assert not list(tmp_path.glob("*data*"))


def test_a_folder_with_something_else_is_refused(
    folder: Path, tmp_path: Path, recipe: dict[str, Any]
) -> None:
    made = fetch_logs(NAME, tmp_path / "data", accept_terms=True, source=folder)
    recipe["digest"] = "1" * 64
    with pytest.raises(OutputError, match="another dataset than retlo-alike-v0"):
        fetch_logs(NAME, made.path, accept_terms=True, source=folder)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "notes.txt").write_text("mine")
    with pytest.raises(OutputError):
        fetch_logs(NAME, tmp_path / "mine", accept_terms=True, source=folder)


def test_the_command(folder: Path, tmp_path: Path, digest: str) -> None:
    listed = CliRunner().invoke(app, ["fetch"])
    assert re.search("alike: a look-alike, .* bytes, licence none stated", listed.output)
    line = ["fetch", NAME, "--out", str(tmp_path / "data"), "--from", str(folder)]
    assert CliRunner().invoke(app, line).exit_code != 0
    assert not (tmp_path / "data").exists()
    made = run(*line, "--accept-terms")
    wanted = ("https://example.org/robots", "none stated", "Nobody, 2020", digest, "12 episodes")
    assert all(text in made for text in wanted)
    with pytest.raises(UnknownNameError, match="alike"):
        fetch_logs("alik")


def test_recipes_of_the_package(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.undo()
    recipes = public_logs.public_logs()
    assert {"mrclam-6", "mrclam-7", "retlo-3", "retlo-5", "turtles"} <= set(recipes)
    assert len({logs.id for logs in recipes.values()}) == len(recipes)
    for logs in recipes.values():
        assert logs.map in shipped_maps()
        assert re.search(r"/[0-9a-f]{40}/", logs.address)  # a commit, which never changes
        assert logs.size < 100e6
