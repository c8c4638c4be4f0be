"""Published datasets are made again and every difference is named."""

import json
from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmdata.building.build import build
from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import DatasetNotFoundError, SchemaError, UnknownNameError
from swarmdata.hub.catalog.listing import dataset_folder
from swarmdata.hub.publishing import regenerate
from swarmdata.hub.publishing.regenerate import (
    Check,
    check,
    differences,
    make_again,
    published_ids,
    put_entries,
    report,
)
from swarmdata.registry.published import Published
from swarmdata.runtime.batches import Failures
from swarmdata.specs.recipe import Recipe
from swarmdata.store.publication import publication
from swarmdata.store.scratch import scratch_folder
from tests.support import tiny

pytestmark = pytest.mark.usefixtures("one_process")

TINY = tiny.TINY.model_copy(update={"id": "coop_nav-tiny-mini-v0"})


@pytest.fixture(scope="module")
def entry(one_process: None, tmp_path_factory: pytest.TempPathFactory) -> Published:
    """What is published of the tiny dataset."""
    folder = build(TINY, tmp_path_factory.mktemp("tiny") / "d", workers=1, progress=False)
    return publication(Dataset.open(folder).stored)


def publish(monkeypatch: pytest.MonkeyPatch, entries: Mapping[str, Published]) -> None:
    """Makes the tiny recipe all that is shipped, and `entries` all that is published."""
    monkeypatch.setattr(regenerate, "published", lambda: MappingProxyType(dict(entries)))
    monkeypatch.setattr(regenerate, "shipped_recipes", lambda: {TINY.id: TINY})
    monkeypatch.setattr(regenerate, "is_dataset", lambda name: name in TINY.id)
    monkeypatch.setattr(regenerate, "find_recipe", lambda name: TINY)


def only(ids: tuple[str, ...], **options: Any) -> Check:
    (found,) = check(ids, Failures(1), workers=1, progress=False, **options)
    return found


@pytest.mark.slow
def test_an_entry_says_what_is_in_a_dataset(tmp_path: Path) -> None:
    dataset = Dataset.open(build(TINY, tmp_path / "d", workers=1, progress=False))
    entry, table = publication(dataset.stored), dataset.episodes

    assert (entry.recipe_hash, entry.digest) == (TINY.hash(), dataset.digest)
    assert entry.mean_return == pytest.approx(table.team_return.mean(), rel=1e-12)
    assert entry.success == table.success.mean()
    assert 0 <= entry.clean_success <= entry.success
    assert set(entry.policies) == {"a", "b"}
    for name in ("n_steps", "n_episodes"):
        assert sum(getattr(each, name) for each in entry.policies.values()) == getattr(entry, name)
    only_b = dataset.filter(policy="b").episodes
    assert entry.policies["b"].mean_return == pytest.approx(only_b.team_return.mean())
    assert Published.parse(asdict(entry)) == entry


def test_the_same_again_is_no_difference(
    monkeypatch: pytest.MonkeyPatch, entry: Published, cache_folder: Path
) -> None:
    publish(monkeypatch, {TINY.id: entry})
    found = only(published_ids(["coop_nav-tiny-mini"]))

    assert found == Check(TINY.id, (), ())
    assert not (cache_folder / "checks").exists()
    assert not dataset_folder(TINY.id).exists()
    assert report([found]) == "1 datasets checked, none with differences\n"


def test_every_difference_is_named(monkeypatch: pytest.MonkeyPatch, entry: Published) -> None:
    other = replace(entry.policies["b"], mean_return=7.5)
    changed = replace(
        entry,
        digest="0" * 64,
        n_bytes=entry.n_bytes + 1,
        recipe_hash="1" * 64,
        policies={**entry.policies, "b": other},
        made_with={**entry.made_with, "pymunk": "1.2.3", "platform": "Moon"},
    )
    publish(monkeypatch, {TINY.id: changed})
    found = only((TINY.id,))

    names = [each.what for each in found.differences]
    assert names == ["digest", "n_bytes", "policies.b.mean_return", "recipe_hash"]
    assert found.differences[2].published == "7.5"
    assert [version.split(" ")[0] for version in found.versions] == ["platform", "pymunk"]
    text = report([found])
    assert text.splitlines()[0].split() == ["dataset", "what", "published", "found"]
    assert "instead of Moon" in text
    assert "1 datasets checked, 1 with differences" in text


def test_a_policy_that_came_or_went_is_a_difference(entry: Published) -> None:
    without = replace(entry, policies={"a": entry.policies["a"]})
    found = differences(TINY.id, without, entry)

    assert {each.what.rpartition(".")[0] for each in found} == {"policies.b"}
    assert {each.published for each in found} == {"none"}


def test_a_published_dataset_without_a_recipe_is_a_difference(
    monkeypatch: pytest.MonkeyPatch, entry: Published
) -> None:
    publish(monkeypatch, {"coop_nav-gone-v0": entry})
    (difference,) = only(("coop_nav-gone-v0",)).differences

    assert (difference.what, difference.found) == ("recipe", "none")


def test_what_an_interrupted_check_left_is_not_used(
    monkeypatch: pytest.MonkeyPatch, entry: Published, cache_folder: Path
) -> None:
    publish(monkeypatch, {TINY.id: entry})
    stale = scratch_folder(cache_folder / "checks" / TINY.id, "check")
    (stale / f"{TINY.id}.build").mkdir(parents=True)
    (stale / f"{TINY.id}.build" / "recipe.json").write_text("{}")
    own = cache_folder / "checks" / TINY.id / "notes"
    own.parent.mkdir()
    own.write_text("of the user's")

    assert only((TINY.id,)).differences == ()
    assert not stale.exists()
    assert own.exists()


@pytest.mark.slow
def test_the_cache_is_used_only_if_asked_for(
    monkeypatch: pytest.MonkeyPatch, entry: Published
) -> None:
    publish(monkeypatch, {TINY.id: entry})
    kept = build(TINY, dataset_folder(TINY.id), workers=1, progress=False)
    built = []

    def counted(recipe: Recipe, out: Path, **options: Any) -> Path:
        built.append(out)
        return build(recipe, out, **options)

    monkeypatch.setattr(regenerate, "build", counted)
    assert only((TINY.id,), cached=True).differences == ()
    assert built == []
    assert only((TINY.id,)).differences == ()
    assert len(built) == 1
    assert kept.exists()


def test_a_failed_build_leaves_nothing(monkeypatch: pytest.MonkeyPatch, cache_folder: Path) -> None:
    def fail(recipe: Recipe, out: Path, **options: Any) -> Path:
        (out.parent / f"{out.name}.build").mkdir(parents=True)
        raise KeyboardInterrupt

    monkeypatch.setattr(regenerate, "build", fail)
    with pytest.raises(KeyboardInterrupt):
        make_again(TINY, workers=1, progress=False)
    assert not (cache_folder / "checks").exists()


def test_ids_are_those_published(monkeypatch: pytest.MonkeyPatch, entry: Published) -> None:
    publish(monkeypatch, {TINY.id: entry, "coop_nav-big-v0": entry})

    assert published_ids() == ("coop_nav-big-v0", TINY.id)
    assert published_ids(minis=True) == (TINY.id,)
    assert published_ids(["coop_nav-tiny-mini", TINY.id]) == (TINY.id,)
    with pytest.raises(UnknownNameError, match="unknown published dataset 'coop_nav-bigg-v0'"):
        published_ids(["coop_nav-bigg-v0"])


KEYS = st.text("abc", max_size=3)


@given(there=st.dictionaries(KEYS, st.integers()), new=st.dictionaries(KEYS, st.integers()))
def test_entries_are_put_into_a_file(
    tmp_path_factory: pytest.TempPathFactory, there: dict[str, int], new: dict[str, int]
) -> None:
    path = tmp_path_factory.mktemp("put") / "file.json"
    put_entries(path, there)
    put_entries(path, new)

    assert json.loads(path.read_text()) == {**there, **new}
    assert list(json.loads(path.read_text())) == sorted({**there, **new})


def test_a_file_that_is_no_object_is_kept(tmp_path: Path) -> None:
    for text, message in (("[", "is not JSON"), ("[]", "holds a list, expected an object")):
        (tmp_path / "f.json").write_text(text)
        with pytest.raises(SchemaError, match=message):
            put_entries(tmp_path / "f.json", {"a": 1})
        assert (tmp_path / "f.json").read_text() == text
    with pytest.raises(DatasetNotFoundError, match="Run this in the repository"):
        put_entries(tmp_path / "no" / "f.json", {"a": 1})
