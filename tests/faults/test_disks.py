"""Disks that are full, read-only, or have strange names: clean errors, and nothing half-written."""

import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from swarmdata.building.build import build
from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import BuildError
from swarmdata.hub.catalog.catalog import load
from swarmdata.hub.catalog.repair import examine, repair
from swarmdata.store import read_manifest
from tests.faults import disk_trouble
from tests.faults.disk_trouble import NO_NAMESPACE
from tests.support.at_once import Forked
from tests.support.pairs import slow
from tests.support.tiny import TINY, abandoned, flip, make_tiny

pytestmark = pytest.mark.usefixtures("one_process")


@pytest.fixture
def digest(tiny: Path) -> str:
    return read_manifest(tiny).digest


def seen(trouble: Callable[..., None], folder: Path, *names: str) -> dict[str, Any]:
    """What a process saw that mounted small disks."""
    code, out, words = Forked(folder, *names, work=trouble).end()
    if code == NO_NAMESPACE:
        pytest.skip("needs mounts of one's own, which this machine refuses")
    assert code == 0, words
    result: dict[str, Any] = json.loads(out.splitlines()[-1])
    return result


@pytest.mark.slow
def test_a_full_disk_is_one_error_and_no_work_is_lost(tmp_path: Path, digest: str) -> None:
    """Row 07: in a part, and while the dataset is put together."""
    found = seen(disk_trouble.full, tmp_path)

    assert found["part"].startswith("DiskFullError: no space is left in")
    assert "MB of it were written" in found["part"]
    assert "Make room and run the same again" in found["part"]
    assert found["left"] == [["d.build"], ["recipe.json"]]
    assert found["assembly"].startswith("DiskFullError")
    assert found["left after assembly"] == ["d.build", "someone elses"]
    assert found["made again"] == [], "finished parts are kept"
    assert (found["digest"], found["damage"]) == (digest, [])
    assert found["at the end"] == ["d"]


@pytest.mark.parametrize(
    "formats", slow(["d4rl"], list(disk_trouble.FORMATS)), ids=["one format", "all formats"]
)
def test_exports_on_a_full_disk_are_one_error_and_leave_nothing(
    tmp_path: Path, formats: list[str]
) -> None:
    """Row 56: formats of others, cards, pictures, clips; at the first byte, halfway, with room."""
    (tmp_path / "disk").mkdir()
    for name, found in seen(disk_trouble.exports, tmp_path / "disk", *formats).items():
        for size in ("small", "middle"):
            error, left = found[size]
            fits = size == "middle" and name == "clip"
            assert error.startswith("none" if fits else "DiskFullError: no space is left"), name
            assert bool(left) == fits, name
        error, left = found["large"]
        assert error == "none", name
        assert left, name
        assert not any(each.startswith(".tmp-") for each in left), name


@pytest.mark.slow
def test_a_disk_without_inodes_is_one_error(tmp_path: Path) -> None:
    """Row 57: there is space and no file can be made; with inodes, it goes on."""
    found = seen(disk_trouble.inodes, tmp_path)
    for each in (found["file"], found["build"]):
        assert each.startswith("DiskFullError: no inode is left in")
        assert "Free some inodes and run the same again" in each
    assert (found["again"], found["left"]) == ("none", ["d"])


def test_a_read_only_cache_serves_what_is_in_it(tmp_path: Path, digest: str) -> None:
    """Row 27: without locks and writes; with a home and a package that are read-only as well."""
    found = seen(disk_trouble.read_only, tmp_path)

    assert found["digests"] == [digest, digest]
    assert (found["source"], found["damage"]) == ("cache", [])
    assert found["uncached"].startswith("BuildError: coop_nav-random-mini-v1 cannot be made")
    assert "Read-only file system. Set SWARMDATA_CACHE" in found["uncached"]
    fresh = found["without a place for kernels"]
    assert fresh.startswith("0 <function make_env"), fresh
    assert "set SWARMDATA_CACHE or NUMBA_CACHE_DIR" in fresh


@pytest.mark.parametrize(
    "name", slow("ünï çødé 群 [a]*?{b} 'quoted\"", "n" * 200), ids=["all", "long"]
)
def test_strange_names_of_folders(tmp_path: Path, digest: str, name: str) -> None:
    """Row 31: a dataset may be anywhere."""
    abandoned(tmp_path / name / name)
    folder = make_tiny(tmp_path / name / name)
    assert load(folder, verify="full").digest == digest
    assert {path.name for path in folder.parent.iterdir()} == {name}
    flip(folder / "data.zarr" / "states" / "c.0.0", 9)
    repair(folder, progress=False)
    assert examine(folder) == ()


@pytest.mark.slow
def test_a_long_and_a_relative_path(
    tmp_path: Path, tiny: Path, monkeypatch: pytest.MonkeyPatch, digest: str
) -> None:
    """Row 31: nested as deep as the system allows, and from where one stands."""
    deep = tmp_path
    while len(str(deep)) < 3700:
        deep = deep / ("d" * 100)
    assert Dataset.open(make_tiny(deep / "d"), "full").digest == digest
    monkeypatch.chdir(tmp_path)
    assert load(shutil.copytree(tiny, Path("here"))).path == Path("here")
    assert examine(Path("here")) == ()


@pytest.mark.slow
def test_a_folder_whose_name_is_no_text(tmp_path: Path, digest: str) -> None:
    """Row 31: bytes that are not UTF-8; such folders come from old archives."""
    folder = tmp_path / os.fsdecode(b"\xe9t\xe9") / "d"
    assert load(make_tiny(folder), verify="full").digest == digest
    code, out, words = Forked("verify", folder).end()
    assert code == 0, words
    assert "all files match the manifest" in out


def test_a_name_that_is_too_long_is_one_error(tmp_path: Path) -> None:
    """Row 31: the system's limit is 255 bytes for one name, temporary names included."""
    with pytest.raises(BuildError, match="File name too long"):
        build(TINY, tmp_path / ("n" * 255), progress=False)
    assert list(tmp_path.iterdir()) == []
