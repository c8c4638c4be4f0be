"""What is listed of the cache is what is there."""

import shutil
from pathlib import Path

import pytest

from swarmdata.hub.catalog.catalog import own_datasets
from tests.support.tiny import TINY, make_tiny

OTHER = "coop_nav-other-v0"

pytestmark = pytest.mark.usefixtures("one_process")


def test_own_datasets_are_listed_as_they_are(cache_folder: Path, tiny: Path) -> None:
    place = cache_folder / "datasets"
    shutil.copytree(tiny, place / TINY.id)
    shutil.copytree(tiny, place / OTHER)
    (found,), (problem,) = own_datasets()
    assert (found.id, found.n_agents, found.is_cached) == (TINY.id, 4, True)
    assert f"{OTHER}: the folder" in problem
    shutil.rmtree(place / OTHER)
    make_tiny(place / OTHER, id=OTHER, n_steps=120)
    assert [info.id for info in own_datasets()[0]] == [OTHER, TINY.id]
    (place / OTHER / "recipe.json").unlink()
    (found,), (problem,) = own_datasets()
    assert found.id == TINY.id
    assert "recipe.json is absent" in problem
