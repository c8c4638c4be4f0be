"""The two sentences of a task, and names of columns in short."""

from pathlib import Path

import pytest

from swarmdata.catalogue.entries import Entry, find_entries
from swarmdata.catalogue.pages.task_facts import arrays_part, column_names, lead, reward_part
from swarmdata.registry.presets import preset, preset_names
from swarmdata.runtime.batches import Failures
from swarmdata.types import Column
from tests.support.image_world import record_images
from tests.support.tiny import TINY


def entry_of(name: str) -> Entry:
    return Entry(
        "x-v1", TINY.model_copy(update={"spec": preset(name)}), 1, 1, 1, 0.0, 0.0, 0.0, None, None,
        None, None,
    )  # fmt: skip


@pytest.mark.parametrize("name", preset_names())
def test_every_task_is_told_in_two_sentences(name: str) -> None:
    text, spec = lead(entry_of(name)), preset(name)

    what, when = text.removesuffix(".").split(". ")
    assert when.startswith("An episode is solved when ")
    assert f"within {spec.horizon} steps" in when
    assert "`" not in text
    assert "N robots" not in what


def test_a_recording_says_what_its_author_does(tmp_path: Path) -> None:
    dataset = record_images(tmp_path / "images", description="Two <agents> paint.")
    (entry,) = find_entries([str(dataset.path)], Failures(1), with_published=False)

    text, arrays = lead(entry), arrays_part(entry)

    assert text.startswith("Episodes of 2 agents in painting_v1, from another environment.")
    assert text.endswith("Two <agents> paint.")
    shape = dataset.stored.manifest.arrays["actions"].shape
    assert f"<code>actions</code></th><td>T, {', '.join(map(str, shape[1:]))}</td>" in arrays
    assert "log_probs" not in arrays


@pytest.mark.parametrize(
    ("names", "text"),
    [
        ("own.x own.y by_0.dx by_0.dy by_1.dx by_1.dy up", "own: x, y; 2 × by: dx, dy; up"),
        ("robot_0.known_0 robot_0.known_1 robot_1.known_0", "2 × robot: known_*"),
    ],
)
def test_slots_and_numbered_columns_are_named_once(names: str, text: str) -> None:
    assert column_names([Column(name, "") for name in names.split()]) == text


def test_reward_and_arrays_have_the_numbers_of_the_spec() -> None:
    reward, arrays = reward_part(preset("coop_nav")), arrays_part(entry_of("coop_nav"))

    assert '<th scope="row">progress</th><td>+2</td>' in reward
    assert '<th scope="row">time</th><td>-0.02</td>' in reward
    assert "<td>T+1, 4, 53</td>" in arrays
    assert "3 × neighbor: dx, dy" in arrays
    assert "<td>T, 4, 8</td>" in arrays
