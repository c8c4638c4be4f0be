"""What entries say of datasets: sizes together, gaps where measured, costs as on the cards."""

from dataclasses import replace
from html import unescape
from importlib.resources import files
from pathlib import Path

import pytest

import swarmdata
from swarmdata.catalogue.entries import collisions_on, find_entries, in_sizes
from swarmdata.catalogue.pages.getting import get_part
from swarmdata.hub.catalog.listing import list_datasets
from swarmdata.registry.published import license_of, published, references
from swarmdata.runtime.batches import Failures
from tests.catalogue.conftest import little_published
from tests.support.tiny import TINY, make_tiny


def test_a_dataset_and_its_mini_are_one(shown: dict[str, Path]) -> None:
    with little_published():
        entries = find_entries([str(shown["tiny"])], Failures(1))

    found = {sizes[0].id: [each.id for each in sizes] for sizes in in_sizes(entries)}

    assert found["coop_nav-medium-v1"] == ["coop_nav-medium-v1", "coop_nav-medium-mini-v1"]
    assert found[TINY.id] == [TINY.id]
    assert sum(map(len, found.values())) == len(entries)
    medium = {entry.id: entry for entry in entries}["coop_nav-medium-v1"]
    assert medium.need is not None
    assert 0 < medium.need < 100
    assert license_of(medium.origin) == "cc-by-4.0"
    assert len(medium.origin.policies) == 4


def test_a_dataset_that_is_shown_says_what_its_table_does(shown: dict[str, Path]) -> None:
    names = [str(shown["tiny"]), str(shown["images"])]
    entries = find_entries(names, Failures(2), with_published=False)
    kinds = {entry.id: entry.kind for entry in entries}
    tiny = next(entry for entry in entries if entry.id == TINY.id)
    images = next(entry for entry in entries if entry.id != TINY.id)

    assert set(kinds.values()) == {"simulated", "other environment"}
    assert tiny.dataset is not None
    assert tiny.collisions is not None
    assert tiny.collisions[0] == tiny.dataset.episodes.robot_collisions.mean()
    assert images.collisions is None
    assert images.need is None


def test_a_task_of_two_sides_is_trained_and_compared_by_its_first() -> None:
    entries = {entry.id: entry for entry in find_entries([], Failures(1))}
    tag, other = entries["tag-expert-v1"], entries["coop_nav-expert-v1"]
    assert dict(tag.gaps) == references()["tag-pursuers"].gaps
    assert "train bc tag-expert-v1 --side pursuers --out" in str(get_part(tag, tag.spec))
    assert "train bc coop_nav-expert-v1 --out" in str(get_part(other, other.spec))


def test_every_published_card_states_its_collisions() -> None:
    cards = files("swarmdata.cards").joinpath("published")
    for name in published():
        found = collisions_on(cards.joinpath(f"{name}.md").read_text(encoding="utf-8"))
        assert found is not None, name
        assert min(found) >= 0
    assert len(published()) == len(list_datasets())
    assert collisions_on("# a card without statistics") is None


def test_a_dataset_in_a_folder_is_loaded_from_beside_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = make_tiny(tmp_path / "mine")
    (entry,) = find_entries([str(folder)], Failures(1), with_published=False)
    small = replace(entry, id="own-mini-v0")
    assert (small.full_id, small.is_mini) == ("own-mini-v0", False), "it is part of no other"
    assert 'swarmdata.load("./mine")' in unescape(str(get_part(entry, entry.spec)))
    monkeypatch.chdir(tmp_path)
    assert swarmdata.load("./mine").digest == entry.digest
