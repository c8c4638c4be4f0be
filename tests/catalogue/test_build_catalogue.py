"""A whole catalogue: what is in it, that it is the same every time, and what it refuses."""

import json
import re
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from swarmdata.catalogue import entries
from swarmdata.catalogue.build_catalogue import CatalogueChoices, build_catalogue
from swarmdata.catalogue.entries import find_entries
from swarmdata.errors import UnknownNameError
from swarmdata.hub.catalog.listing import list_datasets
from swarmdata.runtime.batches import Failures
from tests.catalogue.conftest import few_published, little_published
from tests.support.image_world import record_images
from tests.support.tiny import TINY, make_tiny

MOST_BYTES_OF_A_MINI = 2_000_000


@pytest.fixture(autouse=True, scope="module")
def published() -> Iterator[None]:
    """The studies and published datasets of every catalogue in this file."""
    with little_published():
        yield


def table_of(site: Path, key: str) -> dict[str, object]:
    text = (site / "data" / key / "episodes.js").read_text()
    found = re.fullmatch(r'swarmdata\.episodes\("([^"]+)",(.*)\);\n', text, re.DOTALL)
    assert found is not None
    assert found[1] == key
    content: dict[str, object] = json.loads(found[2])
    return content


def files_of(site: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(site)): path.read_bytes()
        for path in sorted(site.rglob("*"))
        if path.is_file()
    }


@pytest.mark.slow
def test_there_is_a_page_for_each_dataset(site: Path, shown: dict[str, Path]) -> None:
    pages = {path.stem for path in (site / "datasets").iterdir()}
    index = (site / "index.html").read_text()

    ids = {TINY.id, "coop_nav-peer-v0", "formation-small-v0", "painting_v1-mine-v0"}
    assert ids | {info.id for info in few_published()} <= pages
    assert all(f'href="datasets/{page}.html"' in index for page in pages)
    data = {path.name for path in (site / "data").iterdir()}
    assert {name for name in data if name in pages} == {
        page for page in pages if page.endswith("-v0")
    }
    assert len(shown) == len(data & pages)


@pytest.mark.slow
def test_results_of_committed_studies_have_a_page_each(site: Path) -> None:
    pages = {path.stem for path in (site / "results").iterdir()}
    assert "result-goals-maddpg_bc-coop_nav-medium-v1" in pages
    for page in pages:
        assert (site / "data" / page / "measured.js").stat().st_size < 60_000
        assert f'href="results/{page}.html"' in (site / "results.html").read_text()


def test_links_between_pages_lead_somewhere(site: Path) -> None:
    for page in site.rglob("*.html"):
        for link in re.findall(r'href="([^"#:]+)"', page.read_text()):
            assert (page.parent / link).is_file(), f"{page.name}: {link}"


def test_the_table_says_what_the_dataset_has(site: Path) -> None:
    content = table_of(site, TINY.id)

    episodes = content["episodes"]
    assert isinstance(episodes, dict)
    assert episodes["policies"] == ["a", "b"]
    assert set(map(len, (episodes["index"], episodes["length"], episodes["seed"]))) == {
        len(episodes["return"])
    }
    assert all(isinstance(seed, str) for seed in episodes["seed"])  # too large for numbers


@pytest.mark.slow
def test_a_catalogue_of_everything_is_the_same_every_time(
    shown: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(entries, "list_datasets", list_datasets)
    names = [str(shown["tiny"]), str(shown["images"])]
    for out in ("one", "two"):
        build_catalogue(names, tmp_path / out, CatalogueChoices())

    first = files_of(tmp_path / "one")
    assert first == files_of(tmp_path / "two")
    assert {f"datasets/{info.id}.html" for info in list_datasets()} <= first.keys()


@pytest.mark.slow
def test_a_sample_is_shown_and_the_page_says_so(shown: dict[str, Path], tmp_path: Path) -> None:
    build_catalogue([str(shown["tiny"])], tmp_path / "site", CatalogueChoices(episodes=3))

    episodes = table_of(tmp_path / "site", TINY.id)["episodes"]
    assert isinstance(episodes, dict)
    assert len(episodes["index"]) == 3
    assert "3 of " in (tmp_path / "site" / "datasets" / f"{TINY.id}.html").read_text()


@pytest.mark.slow
def test_other_sensors_and_radios_are_shown(shown: dict[str, Path], tmp_path: Path) -> None:
    choices = CatalogueChoices(observation="lidar", communication="lossy-30")
    build_catalogue([str(shown["tiny"])], tmp_path / "site", choices)

    content = table_of(tmp_path / "site", TINY.id)
    world, moving = content["world"], content["moving"]
    assert isinstance(world, dict)
    assert isinstance(moving, list)
    assert world["sensor"]["kind"] == "lidar"
    assert {"heard", "lost"} <= {name for name, *_ in moving}
    page = (tmp_path / "site" / "datasets" / f"{TINY.id}.html").read_text()
    assert "The policies acted with" in page


def test_without_names_the_cache_is_shown(
    shown: dict[str, Path], cache_folder: Path, tmp_path: Path
) -> None:
    place = cache_folder / "datasets"
    shutil.copytree(shown["tiny"], place / TINY.id)
    shutil.copytree(shown["tiny"], place / "broken-v0")
    (place / "broken-v0" / "manifest.json").write_text("{")
    failures = Failures(2)

    found = find_entries([], failures)

    assert [entry.id for entry in found if entry.dataset is not None] == [TINY.id]
    assert list(failures.reasons) == [str(place / "broken-v0")]
    assert len(found) == len(few_published()) + 1


def test_of_two_datasets_of_one_id_the_first_is_shown(
    shown: dict[str, Path], tmp_path: Path
) -> None:
    names = [str(shown["tiny"]), str(make_tiny(tmp_path / "other", seed=9))]
    failures = Failures(2)

    (entry,) = find_entries(names, failures, with_published=False)

    assert entry.dataset is not None
    assert entry.dataset.path == shown["tiny"]
    assert f"two datasets are called {TINY.id}" in failures.reasons[names[1]]


def test_an_unknown_name_is_refused_before_anything_is_written(tmp_path: Path) -> None:
    with pytest.raises(UnknownNameError, match="coop_nav-mediun"):
        build_catalogue(["coop_nav-mediun"], tmp_path / "site", CatalogueChoices())

    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_a_failure_leaves_the_earlier_catalogue(
    shown: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "site"
    build_catalogue([str(shown["tiny"])], out, CatalogueChoices())
    before = files_of(out)

    def fail(*arguments: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("swarmdata.catalogue.build_catalogue.write_data", fail)
    with pytest.raises(KeyboardInterrupt):
        build_catalogue([str(shown["tiny"])], out, CatalogueChoices())

    assert files_of(out) == before
    assert list(tmp_path.iterdir()) == [out]


@pytest.mark.slow
def test_words_of_a_recording_are_escaped(tmp_path: Path) -> None:
    evil = "<img src=x onerror=alert(1)>"
    record_images(tmp_path / "ds", 1, id="painting_v1-evil-v0", author=evil)

    build_catalogue([str(tmp_path / "ds")], tmp_path / "site", CatalogueChoices())

    page = (tmp_path / "site" / "datasets" / "painting_v1-evil-v0.html").read_text()
    assert "<img" not in page
    assert "&lt;img src=x onerror" in page


@pytest.mark.parametrize("key", [TINY.id, "warehouse-small-v0", "painting_v1-mine-v0"])
def test_bytes_for_each_joint_step_stay_below_those_of_a_mini(site: Path, key: str) -> None:
    """A mini of 50,000 steps must stay below 2 MB with its page; small ones have overhead."""
    folder = site / "data" / key
    chunks = [path for path in folder.iterdir() if path.stem.isdigit()]
    episodes = table_of(site, key)["episodes"]
    assert isinstance(episodes, dict)

    n_bytes = sum(path.stat().st_size for path in chunks)

    assert n_bytes / sum(episodes["length"]) < MOST_BYTES_OF_A_MINI / 50_000


@pytest.mark.slow
def test_the_build_says_which_studies_have_no_pages_of_episodes(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    module = "swarmdata.catalogue.build_catalogue"
    monkeypatch.setattr(f"{module}.committed_sources", lambda shown: [])
    monkeypatch.setattr(f"{module}.studies_without_episodes", lambda: ["goals"])
    monkeypatch.setenv("SWARMDATA_CACHE", str(tmp_path / "cache"))
    notes: list[str] = []

    build_catalogue((), tmp_path / "site", CatalogueChoices(), note=notes.append)

    assert any("cards/studies" in text for text in notes)
