"""The card: a golden file, and the checks that keep a wrong dataset from having one."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from swarmdata.analysis.coverage import Coverage, Dependence, Entropies
from swarmdata.analysis.passings import Passings
from swarmdata.analysis.visits import Occupancy
from swarmdata.cards.card import check, render
from swarmdata.cards.sections.measured_content import CardData, LogProbabilities
from swarmdata.cards.sections.problem import observation_rows
from swarmdata.errors import SchemaError, SpecError
from swarmdata.numerics.random import EVALUATION_BASE
from swarmdata.registry.components import make_task
from swarmdata.registry.published import Interval, TaskReferences
from swarmdata.rollouts.metrics import EPISODE_METRICS
from swarmdata.specs.communication_names import communication_model
from swarmdata.specs.features import Feature
from swarmdata.specs.observation_names import observation_model
from swarmdata.specs.recipe import PolicySource, Recipe
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.store import EpisodeTable, Manifest
from swarmdata.store.manifest import ArrayEntry, FileEntry, StatisticsEntry
from tests.support.episode_table import episode_table

GOLDEN = Path(__file__).parent / "golden_card.md"
N_EPISODES = 40


def make_table(**changes: object) -> EpisodeTable:
    index = np.arange(N_EPISODES)
    solved = index % 4 != 0
    columns = {
        "lengths": np.where(solved, 50 + index, 160),
        "seeds": (index + 7).astype(np.uint64),
        "split": np.select([index % 20 == 3, index % 20 == 9], [1, 2], 0),
        "end_reason": np.where(solved, 0, 2),
        "policy": index % 2,
        "team_return": np.where(solved, 4.0 + index / 10, -3.0 - index / 8),
        "success": solved,
        "robot_collisions": index % 3 == 0,
    }
    return episode_table(N_EPISODES, **{**columns, **changes})


def make_card_data(table: EpisodeTable | None = None, n_features: int = 53) -> CardData:
    table = table if table is not None else make_table()
    expert = PolicySource(
        label="expert-0",
        name="learned",
        checkpoint="expert-0.safetensors",
        sha256="b" * 64,
        noise=0.1,
    )
    recipe = Recipe(
        id="coop_nav-golden-v0",
        tier="golden",
        spec=TaskSpec(),
        policies=(PolicySource(label="random", name="random"), expert),
        n_steps=3000,
    )
    steps = int(table.lengths.sum())
    rows = steps + len(table)
    shapes = {
        "actions": (steps, 4, 2), "observations": (rows, 4, n_features), "states": (rows, 32),
    }  # fmt: skip
    arrays = {
        name: ArrayEntry(dtype="float32", shape=shape, chunk_rows=10_000, checksums=("0" * 16,))
        for name, shape in shapes.items()
    }
    manifest = Manifest(
        format_version=1,
        id=recipe.id,
        recipe_hash="c" * 64,
        n_episodes=len(table),
        n_steps=steps,
        digest="d" * 64,
        arrays=arrays,
        files={"recipe.json": FileEntry(size=2_500_000, sha256="e" * 64)},
        statistics=StatisticsEntry(
            observation_mean=(0.0,) * n_features,
            observation_std=(1.0,) * n_features,
            reward_mean=0.0,
            reward_std=1.0,
        ),
        provenance={"numpy": "2.4.6", "platform": "Linux"},
    )
    return CardData(
        manifest, recipe, table, make_coverage(), make_log_probs(), make_references(), True
    )


def make_coverage() -> Coverage:
    visits = np.zeros((4, 4), np.int64)
    visits[1:3, 1] = (6, 2)
    free = np.zeros((4, 4), np.bool_)
    free[1:3, 1:3] = True
    return Coverage(
        n_steps=3700,
        places=Occupancy(visits, free, cell=1.0),
        n_states=3740,
        states=Entropies(robot=2.25, team=2.75),
        actions=Entropies(robot=1.25, team=1.5),
        bounds=0.125,
        distinct=1.0,
        dependence=Dependence(n_pairs=6, information=0.0625, correlation=0.03125),
        passings={0: Passings(0, 0), 1: Passings(9, 1)},
    )


def make_log_probs() -> dict[int, LogProbabilities]:
    likely = LogProbabilities(undefined=0.0, mean=1.75, quantiles=(-3.5, 2.25, 2.75))
    unknown = LogProbabilities(undefined=1.0, mean=np.nan, quantiles=(np.nan,) * 3)
    return {0: unknown, 1: likely}


def make_references() -> TaskReferences:
    def metrics(r: float) -> dict[str, Interval | None]:
        half = Interval(value=0.5, low=0.4, high=0.6)
        own = Interval(value=r, low=r - 1, high=r + 1)
        return {**dict.fromkeys(EPISODE_METRICS, half), "return": own}

    policies = {"idle": metrics(-4.0), "random": metrics(-13.0), "expert": metrics(6.0)}
    policies["idle"]["time_to_goal"] = None
    return TaskReferences(spec_hash="f" * 64, n_episodes=1000, made_with={}, policies=policies)


def test_golden(update_golden: bool) -> None:
    text = render(make_card_data())
    if update_golden:
        GOLDEN.write_text(text, encoding="utf-8")

    assert text == GOLDEN.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("column", "spoil", "claim"),
    [
        ("seeds", lambda v: v + np.uint64(EVALUATION_BASE), "reserved evaluation seed"),
        ("seeds", lambda v: v // np.uint64(2), "occurs twice"),
        ("lengths", lambda v: v + 1, "longer than the horizon"),
        ("end_reason", lambda v: np.full_like(v, 2), "length of the horizon"),
        ("team_return", lambda v: v * np.nan, "finite"),
        ("lengths", lambda v: v // 10, "steps of its recipe"),
    ],
)
def test_dataset_that_fails_a_check_gets_no_card(
    column: str, spoil: Callable[[np.ndarray], np.ndarray], claim: str
) -> None:
    table = make_table(**{column: spoil(getattr(make_table(), column))})

    assert len(check(make_card_data())[0]) == 6
    with pytest.raises(SchemaError, match=claim):
        check(make_card_data(table))


@pytest.mark.parametrize(
    ("observation", "channel"),
    [("state", "none"), ("lidar+stack-2", "state+bits-8"), ("bearing", "learned-3"),
     ("occupancy", "none")],
)  # fmt: skip
def test_every_feature_of_every_model_is_described(observation: str, channel: str) -> None:
    spec = TaskSpec(
        observation=observation_model(observation), communication=communication_model(channel)
    )
    task = make_task(spec)
    rows = observation_rows(task)
    assert all(meaning for *_, meaning in rows)
    assert len(rows) < 40, "slots share their rows"


def test_features_without_description_are_an_error() -> None:
    with pytest.raises(SchemaError, match="observation features: the arrays have 54"):
        render(make_card_data(n_features=54))
    task = make_task(TaskSpec())
    task.features = (Feature("own.mood", "flag"),)
    with pytest.raises(SpecError, match=r"\['own.mood'\] have no description"):
        observation_rows(task)


def test_policy_without_episodes_is_an_error() -> None:
    with pytest.raises(SchemaError, match="'expert-0' made no episode"):
        render(make_card_data(make_table(policy=np.zeros(N_EPISODES, np.uint8))))


def test_what_was_not_found_is_not_on_the_card_and_unrecorded_collisions_are_not_zero() -> None:
    data = make_card_data()
    covered = replace(
        data.coverage, passings={0: Passings(0, 0)}, dependence=None, states=None, actions=None
    )
    text = render(replace(data, coverage=covered, log_probs=None))
    assert "No two robots passed each other head-on" in text
    assert "mutual information" not in text
    assert "Log-probabilities" not in text
    assert text.count("| unknown | needs 6 joint steps |") == 2
    text = render(replace(data, has_events=False))
    assert text.count("not recorded") == 3 * 3  # of all episodes, and of two policies
    assert "| robot collisions per episode | not recorded |" in text


def test_each_side_has_its_return_and_success() -> None:
    made = make_card_data()
    text = render(replace(made, sides={"pursuers": made.table, "evader": made.table}))
    assert text.count("| return of evader, mean |") == 1
    assert text.count("| success of pursuers |") == 1


def test_a_picture_takes_the_place_of_the_histogram() -> None:
    assert "█" in render(make_card_data())
    text = render(make_card_data(), picture="coop_nav-golden-v0.png")
    assert "](coop_nav-golden-v0.png)" in text
    assert "█" not in text
