"""What is listed of the cache is what is there, however it is remembered."""

import hashlib
import json
import os
import shutil
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from swarmdata.hub.catalog import own_datasets as module
from swarmdata.hub.catalog.own_datasets import INDEX, own_datasets
from swarmdata.store import open_store
from tests.support.tiny import TINY, make_tiny

OTHER = "coop_nav-other-v0"


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Names of the folders that were opened; files count as settled at once."""
    names: list[str] = []

    def noted(folder: Path, *options: str) -> object:
        names.append(folder.name)
        return open_store(folder, *options)  # type: ignore[arg-type]

    monkeypatch.setattr(module, "open_store", noted)
    monkeypatch.setattr(module, "SETTLING_TIME", -3600.0)
    return names


@pytest.fixture(scope="module")
def other(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_tiny(tmp_path_factory.mktemp("other") / OTHER, id=OTHER)


@pytest.fixture
def place(cache_folder: Path, tiny: Path, other: Path) -> Path:
    """The cache's datasets: two of them."""
    for folder in (tiny, other):
        shutil.copytree(folder, cache_folder / "datasets" / folder.name)
    return cache_folder / "datasets"


def test_a_dataset_is_opened_once(place: Path, opened: list[str]) -> None:
    first = own_datasets()
    assert len(first[0]) == 2
    assert opened == [OTHER, TINY.id]
    assert own_datasets() == first
    assert len(opened) == 2


def test_what_changed_is_opened_again(place: Path, opened: list[str], tmp_path: Path) -> None:
    own_datasets()
    opened.clear()
    before = (place / OTHER / "manifest.json").stat()
    shutil.rmtree(place / OTHER)
    make_tiny(tmp_path / OTHER, id=OTHER, n_steps=120).rename(place / OTHER)
    os.utime(place / OTHER / "manifest.json", ns=(before.st_atime_ns, before.st_mtime_ns))
    (found, _), opened_after = own_datasets(), list(opened)
    assert opened_after == [OTHER]
    assert sorted(info.n_steps for info in found)[0] < 400

    shutil.rmtree(place / TINY.id)
    assert len(own_datasets()[0]) == 1
    (place / OTHER / "recipe.json").unlink()
    assert own_datasets()[0] == []
    assert len(own_datasets()[1]) == 1


def test_what_was_just_written_may_change_again(
    place: Path, opened: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "SETTLING_TIME", 3600.0)
    own_datasets()
    own_datasets()
    assert len(opened) == 4
    assert not (place.parent / INDEX).exists()


def signed(content: object) -> bytes:
    text = json.dumps(content).encode()
    return module._checksum(text) + b"\n" + text


@pytest.mark.parametrize(
    "damage",
    [
        lambda text: b"",
        lambda text: text[:-20],
        lambda text: text.replace(b'"n_agents":4', b'"n_agents":5'),
        lambda text: (
            hashlib.sha256(text.partition(b"\n")[2]).hexdigest().encode()
            + b"\n"
            + text.partition(b"\n")[2]
        ),  # as if another version had signed it
        lambda text: signed([]),
        lambda text: signed({OTHER: [[], {"id": "x"}]}),
        lambda text: signed(
            json.loads(text.partition(b"\n")[2].replace(TINY.id.encode(), b"\\u001b[31mred"))
        ),
    ],
)
def test_a_damaged_index_is_made_again(place: Path, opened: list[str], damage: object) -> None:
    first = own_datasets()
    index = place.parent / INDEX
    whole = index.read_bytes()
    index.write_bytes(damage(whole))  # type: ignore[operator]
    assert own_datasets() == first
    assert len(opened) == 4
    assert index.read_bytes() == whole


@pytest.mark.parametrize("kind", ["folder", "pipe", "link"])
def test_what_stands_in_the_place_of_the_index_stays(
    place: Path, opened: list[str], tmp_path: Path, kind: str
) -> None:
    index = place.parent / INDEX
    (tmp_path / "mine").write_text("text")
    if kind == "folder":
        (index / "mine").mkdir(parents=True)
    elif kind == "pipe":
        os.mkfifo(index)
    else:
        index.symlink_to(tmp_path / "mine")
    assert len(own_datasets()[0]) == 2
    assert (tmp_path / "mine").read_text() == "text"
    assert kind != "folder" or (index / "mine").is_dir()


def test_processes_that_write_it_at_once_agree(place: Path, opened: list[str]) -> None:
    first = own_datasets()
    (place.parent / INDEX).unlink()
    with ThreadPoolExecutor(8) as pool:
        found = list(pool.map(lambda _: own_datasets(progress=False), range(16)))
    assert all(each == first for each in found)
    opened.clear()
    assert own_datasets() == first
    assert opened == []
    assert {path.name for path in place.parent.iterdir()} == {"datasets", INDEX}


def test_a_cache_without_an_index_is_listed_all_the_same(
    place: Path, opened: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(path: Path, content: bytes) -> None:
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr(module, "write_file", refused)
    assert len(own_datasets()[0]) == 2


def test_an_index_is_read_only_as_long_as_it_is_small(
    place: Path, opened: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    own_datasets()
    monkeypatch.setattr(module, "MAX_INDEX_BYTES", 10)
    assert len(own_datasets()[0]) == 2
    assert len(opened) == 4
