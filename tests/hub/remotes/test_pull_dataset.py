"""A pull is checked, goes on where it was stopped, and is visible at once or never."""

import errno
import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from swarmdata.errors import (
    ChecksumError,
    DatasetError,
    DiskFullError,
    FormatVersionError,
    HubError,
)
from swarmdata.hub.remotes.hosts.folders import FolderRemote
from swarmdata.hub.remotes.interface import Release
from swarmdata.hub.remotes.pull_dataset import fetch_file, pull
from swarmdata.store import open_store, read_manifest
from swarmdata.store.arrays.layout import FORMAT_VERSION
from swarmdata.store.scratch import scratch_folder
from tests.hub.remotes.conftest import ID, is_pulled, same_files
from tests.support.tiny import signed

Change = Callable[[str, bytes], bytes]


class Tampered(FolderRemote):
    """A folder whose files are changed on the way, and whose reads are counted."""

    def __init__(self, root: Path, change: Change = lambda file, content: content) -> None:
        super().__init__(f"file://{root}")
        self.change, self.reads = change, list[str]()

    def read(self, release: Release, file: str, out: Path, size: int) -> None:
        self.reads.append(file)
        super().read(release, file, out, size)
        out.write_bytes(self.change(file, out.read_bytes()))


RELEASE = Release(ID, f"file:///published/{ID}")


@pytest.fixture
def root(dataset: Path) -> Path:
    return dataset.parent


def flip(content: bytes) -> bytes:
    return bytes([content[0] ^ 1]) + content[1:]


def lie(change: Callable[[dict[str, Any]], None]) -> Change:
    """Changes the manifest on the way, and signs it anew."""

    def changed(file: str, content: bytes) -> bytes:
        if file != "manifest.json":
            return content
        data = json.loads(content)
        change(data)
        return signed(data)

    return changed


def test_a_pull_is_the_published_folder(root: Path, dataset: Path, tmp_path: Path) -> None:
    """Row 79: what no digest covers, such as a card, is never asked for."""
    remote = Tampered(root)
    assert pull(remote, RELEASE, tmp_path / ID, progress=False) == tmp_path / ID
    assert is_pulled(tmp_path / ID, dataset)
    assert remote.reads[0] == "manifest.json"
    assert sorted(remote.reads[1:]) == sorted(read_manifest(dataset).files)
    assert {path.name for path in tmp_path.iterdir()} == {ID}

    remote.reads.clear()
    pull(remote, RELEASE, tmp_path / ID, progress=False)
    assert remote.reads == ["manifest.json"]
    assert {path.name for path in tmp_path.iterdir()} == {ID}


def test_the_bar_counts_bytes(
    root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pull(Tampered(root), RELEASE, tmp_path / ID)
    shown = capsys.readouterr().err
    assert f"pulling {ID}: 100%" in shown
    assert "B/s" in shown


def test_something_else_at_the_place_is_left_alone(root: Path, other: Path, tmp_path: Path) -> None:
    shutil.copytree(other, tmp_path / ID)
    with pytest.raises(DatasetError, match="is not this release"):
        pull(Tampered(root), RELEASE, tmp_path / ID, progress=False)
    assert same_files(tmp_path / ID, other)


@pytest.mark.parametrize("n_reads", [1, 5])
def test_a_stopped_pull_goes_on(root: Path, dataset: Path, tmp_path: Path, n_reads: int) -> None:
    def stop(file: str, content: bytes) -> bytes:
        if len(first.reads) > n_reads:
            raise KeyboardInterrupt
        return content

    first = Tampered(root, stop)
    with pytest.raises(KeyboardInterrupt):
        pull(first, RELEASE, tmp_path / ID, progress=False)
    assert not (tmp_path / ID).exists()
    n_kept = sum(
        (scratch_folder(tmp_path / ID, "pull") / name).is_file()
        for name in read_manifest(dataset).files
    )

    second = Tampered(root)
    pull(second, RELEASE, tmp_path / ID, progress=False)

    assert is_pulled(tmp_path / ID, dataset)
    assert len(second.reads) == len(read_manifest(dataset).files) + 1 - n_kept


@pytest.mark.parametrize("step", ["copyfile", "rename"])
def test_a_pull_stopped_at_its_end_goes_on(
    root: Path, dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, step: str
) -> None:
    from swarmdata.hub.remotes import pull_dataset

    with monkeypatch.context() as patch:

        def stop(*args: Any) -> None:
            raise KeyboardInterrupt

        if step == "copyfile":
            patch.setattr(shutil, "copyfile", stop)
            patch.setattr(Tampered, "read", _copy_by_hand)
        else:
            patch.setattr(pull_dataset, "sync_tree", stop)
        with pytest.raises(KeyboardInterrupt):
            pull(Tampered(root), RELEASE, tmp_path / ID, progress=False)
    assert not (tmp_path / ID).exists()

    second = Tampered(root)
    pull(second, RELEASE, tmp_path / ID, progress=False)
    assert is_pulled(tmp_path / ID, dataset)
    assert second.reads == ["manifest.json"]


def stopped_at_the_last_file(
    root: Path, dataset: Path, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Pulls all but the smallest file, one after the other."""
    sizes = {name: entry.size for name, entry in read_manifest(dataset).files.items()}
    last = sorted(sizes, key=lambda name: -sizes[name])[-1]

    def stop(file: str, content: bytes) -> bytes:
        if file == last:
            raise KeyboardInterrupt
        return content

    monkeypatch.setattr("swarmdata.hub.remotes.pull_dataset.N_WORKERS", 1)
    with pytest.raises(KeyboardInterrupt):
        pull(Tampered(root, stop), RELEASE, folder, progress=False)


def _copy_by_hand(self: Tampered, release: Release, file: str, out: Path, size: int) -> None:
    out.write_bytes((self._root / release.id / file).read_bytes())


def test_leftovers_of_another_release_are_thrown_away(
    root: Path, other: Path, dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stopped_at_the_last_file(other.parent, other, tmp_path / ID, monkeypatch)
    (scratch_folder(tmp_path / ID, "pull") / "data.zarr" / "stranger").write_bytes(b"x")
    pull(Tampered(root), RELEASE, tmp_path / ID, progress=False)
    assert is_pulled(tmp_path / ID, dataset)


def test_half_written_leftovers_are_fetched_again(
    root: Path, dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As after a power cut: names are there, bytes are not."""
    stopped_at_the_last_file(root, dataset, tmp_path / ID, monkeypatch)
    (scratch_folder(tmp_path / ID, "pull") / "recipe.json").write_bytes(b"")
    (scratch_folder(tmp_path / ID, "pull") / "stranger.part").write_bytes(b"left")
    pull(Tampered(root), RELEASE, tmp_path / ID, progress=False)
    assert is_pulled(tmp_path / ID, dataset)


def test_a_newer_format(root: Path, tmp_path: Path) -> None:
    remote = Tampered(root, lie(lambda data: data.update(format_version=FORMAT_VERSION + 1)))
    with pytest.raises(FormatVersionError, match="pip install --upgrade"):
        pull(remote, RELEASE, tmp_path / ID, progress=False)
    assert remote.reads == ["manifest.json"]


def _add(name: str) -> Callable[[dict[str, Any]], None]:
    return lambda data: data["files"].update({name: data["files"]["recipe.json"]})


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        (lambda data: data.update(id="coop_nav-another-v0"), "manifest of coop_nav-another-v0"),
        (_add("../../outside"), "plain relative path"),
        (_add("/etc/passwd"), "plain relative path"),
        (_add("RECIPE.json"), "same file"),
        (_add("card.md"), "same file"),
        (_add("manifest.json"), "same file"),
        (_add("more.json"), "without their array"),
        (lambda data: data["files"].pop("recipe.json"), "without their array"),
        (lambda data: data["files"]["recipe.json"].update(size=1 << 40), "expected <="),
        (
            lambda data: data["files"]["data.zarr/actions/c.0.0.0"].update(size=1),
            "listed with 1 bytes",
        ),
    ],
)
def test_a_manifest_that_must_not_be_followed(
    root: Path, tmp_path: Path, change: Callable[[dict[str, Any]], None], problem: str
) -> None:
    remote = Tampered(root, lie(change))
    with pytest.raises(HubError, match=problem):
        pull(remote, RELEASE, tmp_path / ID, progress=False)
    assert remote.reads == ["manifest.json"]
    assert not (tmp_path / ID).exists()


def test_a_page_in_place_of_a_manifest(root: Path, tmp_path: Path) -> None:
    def log_in(file: str, content: bytes) -> bytes:
        return b"<html>Log in</html>"

    with pytest.raises(ChecksumError, match="has no usable manifest") as caught:
        pull(Tampered(root, log_in), RELEASE, tmp_path / "copy", progress=False)
    assert str(tmp_path / "copy") not in str(caught.value)
    assert "has nothing else" not in str(caught.value)
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_is_seen_before(
    root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    usage = shutil.disk_usage(tmp_path)._replace(free=1_000)
    monkeypatch.setattr("swarmdata.hub.remotes.pull_dataset.shutil.disk_usage", lambda path: usage)
    remote = Tampered(root)
    with pytest.raises(DatasetError, match="1,000 are free"):
        pull(remote, RELEASE, tmp_path / ID, progress=False)
    assert remote.reads == ["manifest.json"]


def test_a_disk_that_fills_on_the_way_is_one_error_and_what_has_arrived_is_kept(
    root: Path, dataset: Path, tmp_path: Path
) -> None:
    """Row 56: the next pull goes on there."""
    remote = Tampered(root)

    def fill(file: str, content: bytes) -> bytes:
        if file.endswith("actions/c.0.0.0"):
            raise OSError(errno.ENOSPC, "No space left on device")
        return content

    remote.change = fill
    with pytest.raises(DiskFullError, match=r"no space is left in .* MB of it were written"):
        pull(remote, RELEASE, tmp_path / ID, progress=False)
    assert not (tmp_path / ID).exists()
    assert scratch_folder(tmp_path / ID, "pull").is_dir()
    remote = Tampered(root)
    assert is_pulled(pull(remote, RELEASE, tmp_path / ID, progress=False), dataset)


def test_fetching_one_file(root: Path, dataset: Path, tmp_path: Path) -> None:
    manifest = read_manifest(dataset)
    broken = Path(shutil.copytree(dataset, tmp_path / ID))
    out = broken / "data.zarr" / "actions" / "c.0.0.0"
    out.write_bytes(b"broken")
    name = str(out.relative_to(broken))

    for change in (lambda _, data: flip(data), lambda _, data: data[:-1]):
        with pytest.raises(ChecksumError, match="twice"):
            fetch_file(Tampered(root, change), RELEASE, manifest, name, out)
        assert out.read_bytes() == b"broken"
    fetch_file(Tampered(root), RELEASE, manifest, name, out)
    assert same_files(broken, dataset)
    open_store(broken, "full")
    with pytest.raises(HubError, match="does not list it"):
        fetch_file(Tampered(root), RELEASE, manifest, "card.md", out)
