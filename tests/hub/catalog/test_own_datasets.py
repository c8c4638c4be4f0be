"""What is listed of the cache is what is there now, and nothing is written there."""

import shutil
from pathlib import Path

import pytest

from swarmdata.hub.catalog.listing import own_datasets
from swarmdata.store.arrays.layout import DATA
from tests.support.tiny import TINY, make_tiny

OTHER = "coop_nav-other-v0"


@pytest.fixture
def place(cache_folder: Path, tiny: Path) -> Path:
    """The cache's datasets: two of them."""
    shutil.copytree(tiny, cache_folder / "datasets" / tiny.name)
    make_tiny(cache_folder / "datasets" / OTHER, id=OTHER, n_steps=120)
    return cache_folder / "datasets"


def test_what_is_there_is_listed_from_manifest_and_recipe_alone(place: Path) -> None:
    shutil.rmtree(place / OTHER / DATA)
    before = sorted(place.parent.rglob("*"))
    found, problems = own_datasets()
    assert [info.id for info in found] == [OTHER, TINY.id]
    assert (found[0].task, found[0].tier, found[0].n_agents) == ("coop_nav", TINY.tier, 4)
    assert found[0].n_steps < found[1].n_steps
    assert problems == []
    assert sorted(place.parent.rglob("*")) == before


def test_what_is_no_usable_dataset_is_one_sentence(place: Path) -> None:
    (place / OTHER / "recipe.json").unlink()
    (place / TINY.id).rename(place / "coop_nav-renamed-v0")
    found, problems = own_datasets()
    assert found == []
    absent, misnamed = problems
    assert "recipe.json" in absent
    assert f"holds {TINY.id}" in misnamed
