"""From an id to an open dataset."""

import shutil
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from swarmdata.errors import DatasetNotFoundError, SpecError, UnknownNameError
from swarmdata.hub.catalog import catalog, request
from swarmdata.hub.catalog.catalog import load
from swarmdata.hub.catalog.listing import list_datasets
from swarmdata.registry.published import published
from swarmdata.specs.recipe import Recipe
from swarmdata.specs.rules import chosen_weights
from tests.support.measured import references_at
from tests.support.own_rewards import effort
from tests.support.tiny import TINY

pytestmark = pytest.mark.usefixtures("one_process")


@pytest.fixture
def known(monkeypatch: pytest.MonkeyPatch) -> None:
    """Makes every id mean a recipe that is built in a second."""
    monkeypatch.setattr(request, "find_recipe", lambda dataset_id: TINY)


@pytest.fixture
def cached(known: None, tiny: Path, cache_folder: Path) -> Path:
    """The dataset of every id, in the cache."""
    return Path(shutil.copytree(tiny, cache_folder / "datasets" / TINY.id))


def test_list_shows_every_tier_and_its_mini() -> None:
    infos = {info.id: info for info in list_datasets()}

    assert list(infos) == sorted(infos)
    assert {"coop_nav-random-v1", "coop_nav-scripted-mini-v1"} <= set(infos)
    mini = infos["coop_nav-scripted-mini-v1"]
    assert (mini.task, mini.tier, mini.n_agents) == ("coop_nav", "scripted", 4)
    assert not mini.is_cached


@pytest.mark.usefixtures("known")
def test_load_builds_once_then_reads_the_cache(cache_folder: Path) -> None:
    first = load("coop_nav-tiny", workers=1, progress=False)
    before = {path: path.stat().st_mtime_ns for path in cache_folder.rglob("*")}
    second = load("coop_nav-tiny")
    after = {path: path.stat().st_mtime_ns for path in cache_folder.rglob("*")}

    assert (first.source, second.source) == ("rebuilt", "cache")
    assert first.path == cache_folder / "datasets" / TINY.id
    assert first.digest == second.digest
    assert first.card.count("# coop_nav-tiny-v0") == 1
    assert before == after, "a cache that cannot be written to must do"


@pytest.mark.usefixtures("known")
def test_load_into_a_folder_of_ones_own(tmp_path: Path, cache_folder: Path) -> None:
    dataset = load("coop_nav-tiny", path=tmp_path / "mine", workers=1, progress=False)

    assert dataset.path == tmp_path / "mine"
    assert load("coop_nav-tiny", path=tmp_path / "mine").source == "folder"
    assert not (cache_folder / "datasets").exists()


@pytest.mark.usefixtures("known")
def test_a_wrong_name_costs_no_build(cache_folder: Path) -> None:
    with pytest.raises(UnknownNameError, match="Did you mean 'lidar'"):
        load("coop_nav-tiny", observation="lidra")
    with pytest.raises(SpecError, match="learned messages of 2 values"):
        load("coop_nav-tiny", communication="learned-2")
    with pytest.raises(UnknownNameError, match="Did you mean 'robot_contact'"):
        load("coop_nav-tiny", rewards={"robot_contcat": 1.0})
    assert not list(cache_folder.iterdir())


@pytest.mark.usefixtures("cached")
def test_load_through_other_models() -> None:
    seen = load("coop_nav-tiny", observation="lidar", communication="lossy-30", progress=False)
    recorded = load("coop_nav-tiny")

    assert seen.task.observation.kind == "lidar"
    assert (seen.digest, seen.source) == (recorded.digest, "cache")
    assert (seen.view is None, recorded.view is None) == (False, True)
    assert load("coop_nav-tiny", observation="state", communication="none").view is None


@pytest.mark.usefixtures("cached")
def test_load_with_other_rewards() -> None:
    view, recorded = load("coop_nav-tiny", rewards={"time": "0.5"}), load("coop_nav-tiny")
    assert view.view == '{"rewards":{"time":0.5}}'
    assert view.digest == recorded.digest
    assert (view.episodes.team_return < recorded.episodes.team_return).all()
    safe = load("coop_nav-tiny", rewards="safe")
    weights = chosen_weights("safe", recorded.task.rules)
    assert safe.view == recorded.with_rewards(**weights).view is not None
    with pytest.raises(UnknownNameError, match="unknown set of reward weights 'save'"):
        load("coop_nav-tiny", rewards="save")


@pytest.mark.usefixtures("cached")
def test_load_with_rewards_of_a_function() -> None:
    view = load("coop_nav-tiny", rewards="tests.support.own_rewards:effort", observation="lidar-8")
    np.testing.assert_array_equal(view[0].rewards, effort(view[0]))
    for place, problem in {
        "tests.support.own_rewards:lost": "no attribute 'lost'. Expected it as module:name",
        "no_rewards:effort": "No module named 'no_rewards'",
        "tests.support.own_rewards:np": "is <module 'numpy'.*expected a function",
    }.items():
        with pytest.raises(SpecError, match=problem):
            load("coop_nav-tiny", rewards=place)


@pytest.mark.usefixtures("cached")
def test_load_mixes_a_list() -> None:
    alone = load("coop_nav-tiny", rewards={"time": 0.5})
    mixture = load(["coop_nav-tiny", str(alone.path)], weights=[3, 1], rewards={"time": 0.5})
    assert mixture.weights == (0.75, 0.25)
    assert [part.view for part in mixture.parts] == [alone.view] * 2
    assert load(["coop_nav-tiny"]).id == TINY.id
    with pytest.raises(SpecError, match="expected a list of datasets"):
        load("coop_nav-tiny", weights=[1])  # type: ignore[call-overload]
    with pytest.raises(SpecError, match="path is of one dataset"):
        load(["coop_nav-tiny"], path=alone.path)  # type: ignore[call-overload]


@pytest.mark.usefixtures("known")
def test_references_of_the_same_spec_anchor_the_score(
    tiny: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    known = partial(references_at, idle=-4.0, random=-12.0, expert=6.0)
    monkeypatch.setattr(catalog, "references_of", known)
    dataset = load("x", path=tiny)

    assert dataset.normalized_score([-4.0, 1.0, 6.0]).tolist() == [0.0, 50.0, 100.0]


@pytest.mark.usefixtures("known")
def test_folder_without_manifest_is_refused(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(DatasetNotFoundError, match="nothing that only a dataset"):
        load("x", path=tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["notes.txt"]


@pytest.mark.parametrize("name", ["formation-expert-mini", "formation-expert-mini-v1"])
def test_the_recipe_of_a_published_dataset_is_made_when_it_is_asked_for(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[str] = []

    def find_recipe(name: str) -> Recipe:
        made.append(name)
        return TINY

    monkeypatch.setattr(request, "find_recipe", find_recipe)
    found = request.parse_request(name)
    published_id = "formation-expert-mini-v1"
    assert found.made_from == (published_id, published()[published_id].recipe_hash)
    assert not made
    assert (found.recipe, made) == (TINY, [published_id])
