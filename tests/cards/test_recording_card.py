"""Cards of what no recipe made: recordings and edits."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from swarmdata.building.edit import filter_dataset
from swarmdata.cards.card import card_of, check
from swarmdata.cards.publish import publish_card
from swarmdata.cards.recording_card import describe
from swarmdata.cards.sections.measured_content import card_data_of
from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import SpecError
from swarmdata.record import Recorder
from swarmdata.specs.origins import RecordedSpec
from swarmdata.specs.origins.recording_origin import Recording
from swarmdata.specs.spaces import (
    BoxSpace,
    DictSpace,
    DiscreteSpace,
    MultiBinarySpace,
    MultiDiscreteSpace,
    Space,
    TupleSpace,
)
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.store import open_store
from tests.record.worlds import Choosing, Counting, play, steady


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    path = tmp_path_factory.mktemp("recorded") / "ds"
    env = Counting(leaves={"big": 3}, terminates=True, success=True)
    said = {"author": "Ada | Bo", "license": "mit", "description": "what\nit is", "funding": "none"}
    with Recorder(
        env, id="counting_v1-mine-v0", path=path, policies=("a", "b", "never"), metadata=said,
        options={"length": 4},
    ) as recorder:  # fmt: skip
        for label in ("a", "b"):
            recorder.set_policy(label)
            play(recorder, 20, steady)
    return recorder.close()


def edit_of(dataset: Dataset, out: Path, episodes: list[int]) -> Path:
    """An edit of some episodes of a dataset."""
    name = dataset.id.replace("-v0", "-some-v0")
    return filter_dataset(dataset, out, id=name, tier="edit", episodes=episodes).path


def test_a_recording_says_what_it_is(recorded: Dataset) -> None:
    card = card_of(recorded.path)
    assert card == recorded.card
    front = yaml.safe_load(card.split("---")[1])
    assert front["license"] == "mit"
    assert front["pretty_name"] == recorded.id
    for line in (
        "| environment | `counting_v1` |",
        "| options | length=4 |",
        "| description | what it is |",
        "| author | Ada \\| Bo |",
        "| code | not given |",
        "| funding | none |",
        "| `big` | box of 3 in [-∞, ∞] | 3 | box of 2 in [(-2, 0), (2, 4)] | 2 |",
        "| success | 100.0 % |",
        "| a | external | 20 | 80 |",
        "`alive` marks the agents that act next",
        "| train | 36 | 144 |",
    ):
        assert line in card, line
    assert "| never |" not in card
    assert "Checks passed" in card


def test_what_the_environment_does_not_say_is_not_guessed(tmp_path: Path) -> None:
    with Recorder(Choosing("info"), id="choosing_v2-mine-v0", path=tmp_path / "ds") as recorder:
        play(recorder, 10)
    card = recorder.close().card
    assert "| success | not reported |" in card
    assert "does not report whether its task was solved" in card
    assert "The version of the environment's library is not known" in card
    assert "`action_masks` marks the choices that were allowed" in card
    assert "license: unknown" in card
    assert "| `one` | near: box of 2 x 2 in [0, 255]; phase: discrete, 0 to 4 | 5 |" in card


def test_an_edit_of_a_recording_names_its_parents(recorded: Dataset, tmp_path: Path) -> None:
    card = card_of(edit_of(recorded, tmp_path / "ds", [0, 1, 2, 5]))
    assert "filter(" in card
    assert f"| `{recorded.id}` | `{recorded.digest}` | 4 | 0, 1, 2, 5 |" in card
    assert "Every episode keeps the split it had in its parent dataset" in card
    assert "## About" not in card


def test_an_edit_of_a_task_has_the_usual_card(tmp_path: Path, record: Callable[..., Path]) -> None:
    folder = record(tmp_path / "whole", TaskSpec(horizon=20), ("random", "idle"))
    dataset = Dataset.open(folder)
    chosen = np.flatnonzero(dataset.episodes.policy == 0)[:3].tolist()
    card = card_of(edit_of(dataset, tmp_path / "ds", chosen))
    for title in ("Task", "Coverage", "Parents", "Statistics", "Known limits", "Arrays"):
        assert f"## {title}" in card
    assert "## Rebuild" not in card
    assert "| idle |" not in card, "none of its episodes are left"
    assert "license: unknown" in card


def test_a_check_that_fails_is_a_known_limit_of_a_recording(
    tmp_path: Path, record: Callable[..., Path]
) -> None:
    folder = record(tmp_path / "whole", TaskSpec(horizon=20), ("random",))
    stored = open_store(folder)
    recipe = stored.recipe
    origin = Recording(id=recipe.id, spec=recipe.spec, policies=recipe.policies, source="recorder")
    twice = replace(stored.table, seeds=np.zeros_like(stored.table.seeds))
    data = replace(card_data_of(stored), origin=origin, table=twice)
    holds, broken = check(data)
    assert broken == ["No seed occurs twice."]
    assert broken[0] not in holds
    with pytest.raises(SpecError, match="a card of a task needs a task"):
        card_data_of(replace(stored, recipe=origin.model_copy(update={"spec": foreign()})))


def foreign() -> RecordedSpec:
    return RecordedSpec.model_construct(task="x", library="", agents=())


def test_spaces_in_words() -> None:
    box = BoxSpace(shape=(2, 3), dtype="float32", low=(0.0,) * 6, high=None)
    pairs: dict[str, Space] = {
        "box of 2 x 3 in [(0, 0, 0, 0, 0, 0), ∞]": box,
        "discrete, 1 to 4": DiscreteSpace(n=4, start=1),
        "discrete, 2 x 3 choices": MultiDiscreteSpace(n=(2, 3)),
        "3 bits": MultiBinarySpace(n=3),
        "a: 3 bits; b: discrete, 0 to 1": DictSpace(
            spaces={"b": DiscreteSpace(n=2), "a": MultiBinarySpace(n=3)}
        ),
        "1 bits; 2 bits": TupleSpace(spaces=(MultiBinarySpace(n=1), MultiBinarySpace(n=2))),
    }
    for text, space in pairs.items():
        assert describe(space) == text
    long = BoxSpace(shape=(20,), dtype="float32", low=tuple(map(float, range(20))), high=1.0)
    assert describe(long) == "box of 20 in [(0, 1, 2, 3, 4, 5, 6, …), 1]"


@pytest.mark.slow
def test_the_picture_shows_returns_lengths_and_actions(recorded: Dataset, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    pil = pytest.importorskip("PIL.Image")
    text, picture = publish_card(recorded.path, tmp_path)
    assert f"]({picture.name})" in text.read_text(encoding="utf-8")
    with pil.open(picture) as image:
        assert image.size == (1600, 576)
