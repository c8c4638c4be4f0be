"""Folders that share nothing but a remote: parts travel, and the dataset is the same."""

import shutil
from collections.abc import Callable
from pathlib import Path

import fsspec
import pytest

from swarmdata.building.part_exchange import PartExchange
from swarmdata.building.parts_folder import Parts, build_folder
from swarmdata.building.shares import finish_parts, make_share, receive_parts
from swarmdata.errors import BuildError, ChecksumError, HubError
from swarmdata.hub.remotes.hosts.buckets import BucketRemote
from swarmdata.hub.remotes.hosts.folders import FolderRemote
from swarmdata.hub.remotes.hosts.web import WebRemote
from swarmdata.hub.remotes.interface import Remote
from swarmdata.store import read_manifest
from tests.building.conftest import SMALL
from tests.support.at_once import run_at_once
from tests.support.command_line import run
from tests.support.tiny import flip

pytestmark = pytest.mark.usefixtures("one_process")


def bucket(folder: Path) -> Remote:
    fsspec.filesystem("memory").store.clear()
    return BucketRemote("memory://parts")


def folder(folder: Path) -> FolderRemote:
    (folder / "shelf").mkdir()
    return FolderRemote((folder / "shelf").as_uri())


@pytest.fixture
def shelf(tmp_path: Path) -> FolderRemote:
    return folder(tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("make_remote", [folder, bucket])
def test_machines_that_share_a_remote_make_the_dataset(
    make_remote: Callable[[Path], Remote], tmp_path: Path, tiny_digest: str
) -> None:
    remote = make_remote(tmp_path)
    made = [make_share(SMALL, tmp_path / f"{k}" / "d", k, 2, remote=remote) for k in (2, 1)]
    assert all(made)
    assert remote.ids() == ()  # parts are no dataset
    out = tmp_path / "last" / "d"
    assert receive_parts(SMALL, out, remote) == sum(map(len, made))
    assert receive_parts(SMALL, out, remote) == 0
    assert read_manifest(finish_parts(SMALL, out, progress=False)).digest == tiny_digest
    assert receive_parts(SMALL, out, remote) == 0
    assert not (tmp_path / "last" / "d.build").exists()


@pytest.mark.slow
def test_a_machine_goes_on_where_another_one_died(
    shelf: FolderRemote, tmp_path: Path, tiny_digest: str
) -> None:
    first = tmp_path / "first" / "d"
    made = make_share(SMALL, first, 1, 1, remote=shelf)
    box = next((tmp_path / "shelf").iterdir())
    sent = sorted(box.iterdir())
    assert len(sent) == len(made)
    sent[-1].unlink()  # killed before the last one was sent
    second = tmp_path / "second" / "d"
    assert make_share(SMALL, second, 1, 1, remote=shelf) == made[-1:]
    assert sorted(box.iterdir()) == sent
    sent[-1].unlink()
    assert make_share(SMALL, first, 1, 1, remote=shelf) == []
    assert sorted(box.iterdir()) == sent, "what is here is sent again"
    assert read_manifest(finish_parts(SMALL, second, progress=False)).digest == tiny_digest


def test_a_damaged_part_is_not_taken(shelf: FolderRemote, tmp_path: Path) -> None:
    make_share(SMALL, tmp_path / "d", 1, 1, remote=shelf)
    flip(next((tmp_path / "shelf").rglob("*.tar")), 1000)
    with pytest.raises(ChecksumError, match="is damaged: its content has another SHA-256"):
        receive_parts(SMALL, tmp_path / "other" / "d", shelf)


def test_two_machines_that_do_not_agree_are_told(shelf: FolderRemote, tmp_path: Path) -> None:
    make_share(SMALL, tmp_path / "d", 1, 1, remote=shelf)
    file = next((tmp_path / "shelf").rglob("*.tar"))
    part = file.name.partition(".")[0]
    shutil.copyfile(file, file.with_name(f"{part}.{'0' * 64}.tar"))
    with pytest.raises(BuildError, match=f"has two different copies of {part}"):
        make_share(SMALL, tmp_path / "other" / "d", 1, 1, remote=shelf)


def test_a_part_is_packed_into_the_same_bytes(shelf: FolderRemote, tmp_path: Path) -> None:
    for name in ("a", "b"):
        make_share(SMALL, tmp_path / name / "d", 1, 2)
        parts = Parts(SMALL, build_folder(tmp_path / name / "d"))
        exchange = PartExchange(parts, shelf)
        exchange.there.clear()
        exchange.send()
    exchange.look()  # raises if they differ
    assert len(exchange.there) == len(parts.all())


def test_a_remote_of_whole_datasets_is_refused(tmp_path: Path) -> None:
    remote = WebRemote("https://example.org/data")
    with pytest.raises(HubError, match=r"takes whole datasets only[.] Let parts travel through"):
        make_share(SMALL, tmp_path / "d", 1, 1, remote=remote)


@pytest.mark.slow
def test_commands_on_machines_without_a_shared_folder(tmp_path: Path, tiny_digest: str) -> None:
    recipe = tmp_path / "recipe.json"
    recipe.write_text(SMALL.to_json())
    (tmp_path / "shelf").mkdir()
    remote = (tmp_path / "shelf").as_uri()

    def line(name: str, *options: str) -> tuple[str | Path, ...]:
        return ("generate", recipe, "--out", tmp_path / name / "d", "--remote", remote, *options)

    run_at_once(line("a", "--part", "1/2"), line("b", "--part", "2/2"), line("c", "--part", "2/2"))
    result = run(*map(str, line("d", "--finish")))
    assert tiny_digest in result
