"""A card's picture: its size, what it shows, and what it does without the extra."""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmdata.cards.pictures.panels import (
    MAX_RIDGES,
    N_EPISODES_SHOWN,
    choose_episodes,
    draw_actions,
    draw_lengths,
    draw_returns,
)
from swarmdata.cards.pictures.sheet import MAX_PICTURE_BYTES, draw_card
from swarmdata.cards.publish import publish_card
from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import MissingExtraError, SchemaError
from swarmdata.registry.presets import preset
from swarmdata.specs.recipe import PolicySource, Recipe
from swarmdata.specs.task_spec import TaskSpec
from tests.support.episode_table import episode_table
from tests.support.pairs import slow

pytest.importorskip("matplotlib")
pil = pytest.importorskip("PIL.Image")

Record = Callable[..., Path]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, record: Record) -> Path:
    out = tmp_path_factory.mktemp("pictures") / "data"
    return record(out, TaskSpec(horizon=40), ("random", "straight", "idle"))


@pytest.mark.slow
def test_published_text_shows_one_sheet_of_fixed_size_with_a_palette(
    folder: Path, tmp_path: Path
) -> None:
    text, picture = publish_card(folder, tmp_path / "cards")
    assert (text.name, picture.name) == ("coop_nav-small-v0.md", "coop_nav-small-v0.png")
    assert f"]({picture.name})" in text.read_text(encoding="utf-8")
    with pil.open(picture) as image:
        assert (image.size, image.mode) == ((1600, 1000), "P")
    assert picture.stat().st_size <= MAX_PICTURE_BYTES


@pytest.mark.parametrize("name", slow("transport", "formation-unicycle"))
def test_every_kind_of_task_is_drawn(name: str, tmp_path: Path, record: Record) -> None:
    spec = preset(name).with_updates(horizon=12)
    dataset = Dataset.open(record(tmp_path / "data", spec, ("random",)))
    draw_card(dataset, tmp_path / "card.png")
    assert (tmp_path / "card.png").stat().st_size > 20_000


@pytest.mark.slow
def test_a_view_of_one_episode_is_drawn(folder: Path, tmp_path: Path) -> None:
    dataset = Dataset.open(folder)
    best = dataset.filter(min_return=float(dataset.episodes.team_return.max()))
    assert len(best) == 1
    draw_card(best, tmp_path / "card.png")
    assert (tmp_path / "card.png").exists()


def test_other_files_are_refused(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(SchemaError, match=r"ends in '.png'"):
        draw_card(Dataset.open(folder), tmp_path / "card.jpg")


def test_without_matplotlib_the_text_can_be_had(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(MissingExtraError, match=r"--no-pictures.*pip install 'swarmdata\[plots\]'"):
        publish_card(folder, tmp_path / "cards")
    assert not (tmp_path / "cards").exists()
    (text,) = publish_card(folder, tmp_path / "cards", pictures=False)
    assert "█" in text.read_text(encoding="utf-8")


@given(
    st.lists(st.tuples(st.integers(0, 6), st.floats(-9, 9)), min_size=1, max_size=30),
    st.integers(1, 6),
)
def test_chosen_episodes_differ_and_share_the_policies(
    rows: list[tuple[int, float]], n: int
) -> None:
    policies, returns = zip(*rows, strict=True)
    table = episode_table(len(rows), policy=policies, team_return=returns)
    chosen = choose_episodes(table, n)
    there = [index for index in chosen if index is not None]
    assert len(chosen) == n
    assert len(there) == len(set(there)) >= 1
    assert len(set(table.policy[there].tolist())) == min(n, len(set(table.policy.tolist())))


def test_one_policy_shows_its_spread() -> None:
    returns = np.random.default_rng(0).permutation(8).astype(float)
    chosen = choose_episodes(episode_table(8, team_return=returns))
    assert len(chosen) == N_EPISODES_SHOWN
    assert [returns[index] for index in chosen if index is not None] == [1, 3, 5, 7]


def panel() -> Any:
    from matplotlib.figure import Figure

    return Figure().add_subplot()


def test_lengths_are_counted_by_reason() -> None:
    table = episode_table(4, lengths=[10, 20, 160, 160], end_reason=[0, 1, 2, 2])
    axes = panel()
    draw_lengths(axes, table, 160, "joint steps")
    shown = [text.get_text() for text in axes.get_legend().get_texts()]
    assert shown == ["success 25 %", "failure 25 %", "horizon 50 %"]
    assert sum(bar.get_height() for bar in axes.patches) == 4


@pytest.mark.parametrize("n", [1, MAX_RIDGES, MAX_RIDGES + 1, 40])
def test_returns_name_every_policy_or_every_few(n: int) -> None:
    recipe = Recipe(
        id="coop_nav-many-v0",
        tier="many",
        spec=TaskSpec(),
        policies=tuple(PolicySource(label=f"p{k}", name="random") for k in range(n)),
    )
    values = np.random.default_rng(n).normal(size=3 * n)
    axes = panel()
    table = episode_table(3 * n, policy=list(range(n)) * 3, team_return=values)
    draw_returns(axes, table, recipe)
    ridges = [text.get_text().split("\n")[0] for text in axes.texts]
    rows = [label.get_text() for label in axes.get_yticklabels()]
    if n <= MAX_RIDGES:
        assert ridges == [f"p{k}" for k in range(n)]
    else:
        assert axes.images
        assert 7 <= len(rows) <= 14
        assert rows[0] == "p0"


def test_commands_are_named_after_the_dynamics() -> None:
    actions = np.zeros((5, 4, 2), np.float32)
    axes = panel()
    draw_actions(axes, actions, preset("coop_nav-unicycle"))
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("command forward", "command turn")
    axes = panel()
    draw_actions(axes, actions, TaskSpec())
    assert axes.get_xlabel() == "command along x"
