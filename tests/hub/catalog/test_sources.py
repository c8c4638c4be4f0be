"""From an id or an address to a folder: the cache, the remotes in order, a rebuild; offline."""

import json
import re
import shutil
import warnings
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmdata.building.parts_folder import Parts, build_folder
from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import (
    DatasetNotFoundError,
    HubError,
    MissingManifestError,
    SpecError,
    UnknownNameError,
)
from swarmdata.hub.catalog import request, sources
from swarmdata.hub.catalog.catalog import find_folder, load
from swarmdata.hub.catalog.request import (
    Found,
    Request,
    is_offline,
    request_of_address,
    request_of_id,
    request_of_recipe,
)
from swarmdata.hub.catalog.sources import (
    Remotes,
    RemoteSkippedWarning,
    obtain,
    obtain_release,
)
from swarmdata.hub.remotes.interface import Release, Remote
from swarmdata.registry.published import Published
from swarmdata.registry.recipes import find_recipe
from swarmdata.store.scratch import scratch_folder
from tests.support.tiny import TINY, Shelf, flip, make_tiny, sign

FOREIGN = "lab-warehouse_run-v3"


pytestmark = pytest.mark.usefixtures("one_process")


@pytest.fixture(scope="module")
def other(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Another dataset under the same id, as after a recipe has changed."""
    return make_tiny(tmp_path_factory.mktemp("other") / TINY.id, seed=6)


@pytest.fixture(scope="module")
def foreign(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dataset that no shipped recipe makes."""
    return make_tiny(tmp_path_factory.mktemp("foreign") / FOREIGN, id=FOREIGN)


def configure(monkeypatch: pytest.MonkeyPatch, *shelves: Shelf) -> None:
    """Makes these the remotes, in this order."""
    known: dict[str, Remote] = {shelf.address: shelf for shelf in shelves}
    monkeypatch.setattr(sources, "open_remote", known.__getitem__)
    monkeypatch.setattr(sources, "locate", lambda text: _locate(known, text))
    monkeypatch.setenv("SWARMDATA_REMOTES", ",".join(known))


def fetch(wanted: Request, *shelves: Shelf) -> Found:
    """The dataset from the first source that has it, these remotes among them."""
    return obtain(wanted, Remotes([shelf.address for shelf in shelves], progress=False))


def _locate(known: dict[str, Remote], text: str) -> tuple[Remote, Release]:
    remote = known[text.rpartition("/")[0]]
    release = remote.find(text.rpartition("/")[2])
    assert release is not None
    return remote, release


@pytest.fixture
def shipped(monkeypatch: pytest.MonkeyPatch, published: Published) -> None:
    """The tiny recipe is one that the package ships and has published."""
    monkeypatch.setattr(
        request, "find_recipe", lambda name: TINY if name in TINY.id else find_recipe(name)
    )


@pytest.mark.usefixtures("shipped")
def test_load_asks_the_remotes_in_order_then_reads_the_cache(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, tiny: Path, cache_folder: Path
) -> None:
    first, second = Shelf(tmp_path / "1"), Shelf(tmp_path / "2", tiny)
    configure(monkeypatch, first, second)
    dataset = load("coop_nav-tiny", progress=False)
    asked = first.requests, second.requests

    assert dataset.source == f"{second.address}/{TINY.id}"
    assert dataset.path == cache_folder / "datasets" / TINY.id
    assert dataset.digest == Dataset.open(tiny, "full").digest
    assert dataset.card == (tiny / "card.md").read_text()
    assert load("coop_nav-tiny").source == "cache"
    assert (first.requests, second.requests) == asked, "a warm cache needs no request"
    assert [path.name for path in cache_folder.glob("datasets/[!.]*")] == [TINY.id]


@pytest.mark.usefixtures("shipped")
def test_a_remote_with_another_dataset_is_skipped_by_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, tiny: Path, other: Path
) -> None:
    """Wrong digest, a signed lie about the digest, a failing server; then the right one."""
    wrong, lying = Shelf(tmp_path / "wrong", other), Shelf(tmp_path / "lying", other)
    content = json.loads((tmp_path / "lying" / TINY.id / "manifest.json").read_bytes())
    digest = Dataset.open(tiny).digest
    sign(tmp_path / "lying" / TINY.id, {**content, "digest": digest})
    broken, right = Shelf(tmp_path / "broken", tiny, fails=True), Shelf(tmp_path / "right", tiny)
    configure(monkeypatch, wrong, lying, broken, right)
    with pytest.warns(RemoteSkippedWarning) as caught:
        dataset = load("coop_nav-tiny", progress=False)

    assert (dataset.digest, dataset.source) == (digest, f"{right.address}/{TINY.id}")
    messages = [str(warning.message) for warning in caught]
    assert len(messages) == 3
    for shelf, message in zip((wrong, lying, broken), messages, strict=True):
        assert message.startswith(f"{shelf.address} is skipped for {TINY.id}")
    assert "ChecksumError" in messages[0]
    assert "503" in messages[2]


@pytest.mark.usefixtures("shipped")
def test_offline_asks_nobody(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, tiny: Path) -> None:
    shelf = Shelf(tmp_path / "1", tiny)
    configure(monkeypatch, shelf)
    assert load("coop_nav-tiny", offline=True, progress=False).source == "rebuilt"
    assert load("coop_nav-tiny", offline=True).source == "cache"
    assert shelf.requests == 0


@pytest.mark.parametrize("name", ["SWARMDATA_OFFLINE", "HF_HUB_OFFLINE"])
def test_the_environment_says_offline(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    assert not is_offline()
    for value, expected in {"1": True, "true": True, "0": False, "": False}.items():
        monkeypatch.setenv(name, value)
        assert is_offline() == expected
        assert is_offline(True)
        assert is_offline(False) == expected, "where no network shall be used, no program uses it"


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        ("failing", "answered 503"),
        ("damaged", "actions"),
        ("of another recipe", f"expected {TINY.hash()[:12]}"),
    ],
)
def test_where_every_remote_is_skipped_it_is_rebuilt(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, tiny: Path, other: Path, fault: str, said: str
) -> None:
    """Where no digest is published, the recipe must be the same."""
    there = other if fault == "of another recipe" else tiny
    shelf = Shelf(tmp_path / "shelf", there, fails=fault == "failing")
    if fault == "damaged":
        flip(tmp_path / "shelf" / TINY.id / "data.zarr" / "actions" / "c.0.0.0", 99)
    configure(monkeypatch, shelf)
    with pytest.warns(RemoteSkippedWarning, match=said):
        found = fetch(request_of_recipe(TINY, tmp_path / "d"), shelf)
    assert found.source == "rebuilt"
    assert {path.name for path in tmp_path.iterdir()} == {"shelf", "d"}, "nothing that arrived"


def test_what_a_killed_fetch_left_is_of_no_consequence(tmp_path: Path, tiny: Path) -> None:
    shelf = Shelf(tmp_path / "shelf", tiny)
    arriving = Path(shutil.copytree(tiny, scratch_folder(tmp_path / "d", "arriving")))
    flip(arriving / "recipe.json", 30)
    build_folder(tmp_path / "d").mkdir()
    found = fetch(request_of_recipe(TINY, tmp_path / "d"), shelf)
    assert found.source == f"{shelf.address}/{TINY.id}"
    Dataset.open(tmp_path / "d", "full")
    left = {path.name for path in tmp_path.iterdir()}
    assert left == {"shelf", "d"}


def test_a_pull_over_an_interrupted_build_leaves_no_parts(tmp_path: Path, tiny: Path) -> None:
    shelf, folder = Shelf(tmp_path / "shelf", tiny), tmp_path / "d"
    parts = Parts(TINY, build_folder(folder))
    parts.open(None)
    parts.path(0, 0).mkdir()
    release = shelf.find(TINY.id)
    assert release is not None
    obtain_release(shelf, release, folder, progress=False)
    assert {path.name for path in tmp_path.iterdir()} == {"shelf", "d"}


def test_an_id_that_only_a_remote_has(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, foreign: Path
) -> None:
    older = tmp_path / "older"
    make_tiny(older, id="lab-warehouse_run-v2")
    shelf = Shelf(tmp_path / "1", foreign, older)
    configure(monkeypatch, shelf)
    dataset = load("lab-warehouse_run", progress=False)

    assert (dataset.id, dataset.source) == (FOREIGN, f"{shelf.address}/{FOREIGN}")
    shelf.requests = 0
    assert load(FOREIGN).source == "cache"
    assert shelf.requests == 0
    assert load("lab-warehouse_run", offline=True).id == FOREIGN
    assert find_folder("lab-warehouse_run") == dataset.path
    with pytest.raises(SpecError, match="Leave it out"):
        load(FOREIGN, path=tmp_path / "x")


def test_an_id_that_is_nowhere_says_what_to_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cache_folder: Path
) -> None:
    shelf = Shelf(tmp_path / "1")
    configure(monkeypatch, shelf)
    with pytest.raises(UnknownNameError) as caught:
        load("coop_nav-scirpted")
    assert "Did you mean 'coop_nav-scripted'" in str(caught.value)
    assert f"Remotes asked: {shelf.address}" in str(caught.value)
    assert "swarmdata pull coop_nav-scirpted --from" in str(caught.value)
    with pytest.raises(UnknownNameError, match="run with a network, and without"):
        load(FOREIGN, offline=True)
    monkeypatch.setenv("SWARMDATA_REMOTES", "")
    with pytest.raises(UnknownNameError, match="none is configured"):
        load(FOREIGN)
    assert not [path for path in cache_folder.rglob("*") if not path.name.startswith(".")][1:]


@given(name=st.text(max_size=40) | st.text("abv0-_/. \n", max_size=99))
def test_no_text_but_an_id_reaches_a_path_or_a_remote(name: str) -> None:
    if re.fullmatch(r"[a-z0-9_]+(-[a-z0-9_]+)+", name):
        return
    # a remote that cannot be opened warns, and warnings are errors
    with pytest.raises(UnknownNameError):
        obtain(request_of_id(name), Remotes(["file:///absent"]))


def test_a_remote_that_cannot_list_is_skipped(tmp_path: Path, foreign: Path) -> None:
    broken = Shelf(tmp_path / "broken")
    shutil.rmtree(tmp_path / "broken")
    right = Shelf(tmp_path / "right", foreign)
    with pytest.warns(RemoteSkippedWarning, match="there is no folder"):
        found = fetch(request_of_id("lab-warehouse_run"), broken, right)
    assert found.folder.name == FOREIGN


def test_an_address_is_fetched_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, foreign: Path, cache_folder: Path
) -> None:
    shelf = Shelf(tmp_path / "1", foreign)
    configure(monkeypatch, shelf)
    address = f"{shelf.address}/{FOREIGN}"
    with pytest.raises(DatasetNotFoundError, match=f"run: swarmdata pull {address}"):
        load(address, offline=True)
    assert shelf.requests == 0
    assert load(address, progress=False).source == address
    shelf.requests = 0
    assert load(address).source == "cache"
    assert load(address, offline=True).source == "cache"
    assert shelf.requests == 0
    assert find_folder(address).is_relative_to(cache_folder / "remotes")


def test_a_cached_copy_that_lost_its_manifest_says_how_to_repair_it(
    tmp_path: Path, foreign: Path
) -> None:
    shelf = Shelf(tmp_path / "1", foreign)
    found = fetch(request_of_id(FOREIGN), shelf)
    (found.folder / "manifest.json").unlink()
    with pytest.raises(MissingManifestError, match=f"verify {found.folder} --repair"):
        fetch(request_of_id(FOREIGN), shelf)


def test_a_remote_that_fails_an_address_is_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, foreign: Path
) -> None:
    shelf = Shelf(tmp_path / "1", foreign, fails=True)
    configure(monkeypatch, shelf)
    with pytest.raises(HubError, match="503"):
        load(f"{shelf.address}/{FOREIGN}")


class HubShelf(Shelf):
    """Answers like a Hub: a name without version, and commits."""

    commit = "5" * 40

    def at(self, text: str) -> tuple[Remote, Release]:
        self._asked()
        return self, Release(FOREIGN, f"hf://lab/warehouse_run@{self.commit}")


@pytest.mark.parametrize(
    ("revision", "requests"), [("@v3", 0), (f"@{'5' * 40}", 0), ("@main", 1), ("", 1)]
)
def test_what_is_pinned_on_a_hub_needs_no_request_when_warm(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, foreign: Path, revision: str, requests: int
) -> None:
    shelf = HubShelf(tmp_path / "1", foreign)
    monkeypatch.setattr(sources, "locate", shelf.at)
    address = f"hf://lab/lab-warehouse_run{revision}"
    first = obtain(request_of_address(address), Remotes(progress=False))
    assert first.source == f"hf://lab/warehouse_run@{'5' * 40}"
    shelf.requests = 0
    again = obtain(request_of_address(address), Remotes(progress=False))
    assert (again.folder, again.source) == (first.folder, "cache")
    assert shelf.requests == requests
    if revision != "@main":
        offline = obtain(request_of_address(address), Remotes(offline=True))
        assert offline.folder == first.folder


def test_a_folder_is_a_dataset_and_never_shadows_an_id(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, tiny: Path
) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert load(tiny).source == load(str(tiny)).source == "folder"
    with pytest.raises(DatasetNotFoundError, match="no dataset folder"):
        load(tmp_path / "nothing")
    (tmp_path / "coop_nav-random-mini").mkdir()
    monkeypatch.chdir(tmp_path)
    assert find_folder("coop_nav-random-mini").is_absolute()


def test_no_two_remotes_share_a_place(tmp_path: Path) -> None:
    slugs: set[Any] = {
        request._slug(remote) for remote in ("s3://a/b", "s3://a-b", "s3://a/b-", "hf://a/b")
    }
    assert len(slugs) == 4
    assert all(len(slug) < 100 and "/" not in slug for slug in slugs)
