"""Policies in two simulators: the same seeds, paired tables, ranks, and what is refused."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from swarmdata.errors import SpecError, UnknownNameError
from swarmdata.evaluation.robustness.simulator_transfer import (
    TeamTransfer,
    compare_simulators,
    rank_agreement,
)
from swarmdata.registry.presets import preset
from swarmdata.types import Double
from tests.support.measured import csv_rows

ROOT = Path(__file__).parents[3]

NAMES = ("idle", "random", "straight")


def compared(names: Sequence[str], out: Path, n_episodes: int) -> list[TeamTransfer]:
    return compare_simulators(
        names, out, backend="kinematic", task="coop_nav", n_episodes=n_episodes, progress=False
    )


def metric(team: TeamTransfer, name: str) -> list[Double]:
    return [case.metric(team.label, name) for case in team.cases.values()]


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("out")


@pytest.fixture(scope="module")
def teams(out: Path) -> list[TeamTransfer]:
    return compared(NAMES, out, 3)


def test_both_simulators_play_the_same_episodes(teams: list[TeamTransfer]) -> None:
    assert [team.label for team in teams] == list(NAMES)
    for team in teams:
        assert list(team.cases) == ["pymunk", "kinematic"]
        (known,), (new,) = (case.runs[team.label] for case in team.cases.values())
        np.testing.assert_array_equal(known.evaluation.seeds, new.evaluation.seeds)
        assert known.spec.world is not None
        assert new.spec == known.spec.world.with_updates(backend="kinematic")
        assert new.evaluation.spec_hash != known.evaluation.spec_hash
    idle, _, straight = teams
    known_length, new_length = metric(idle, "length")
    np.testing.assert_array_equal(known_length, new_length)
    before, after = metric(straight, "obstacle_collisions")
    assert before.shape == after.shape == (1, 3)
    assert before.sum() > after.sum() == 0.0, "nothing touches anything without contacts"


def test_scores_are_on_the_scale_of_the_first(teams: list[TeamTransfer]) -> None:
    known, new = teams[0].scores()
    np.testing.assert_array_equal(known, new)  # idle robots: the same return, the same scale
    found = rank_agreement(teams)
    assert found is not None
    assert -1.0 <= found.low <= found.value <= found.high <= 1.0
    assert rank_agreement(teams[:2]) is None


def test_what_cannot_be_compared_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SpecError, match="idle acts in pymunk already"):
        compare_simulators(["idle"], tmp_path, backend="pymunk")
    with pytest.raises(UnknownNameError, match="Did you mean 'mujoco'"):
        compare_simulators(["idle"], tmp_path, backend="mujoko")
    assert not list(tmp_path.iterdir())
    without_references = tmp_path / "task.yaml"
    without_references.write_text(preset("coop_nav").with_updates(horizon=7).to_yaml())
    out = tmp_path / "out"
    with pytest.raises(SpecError, match="coop_nav has no score"):
        compare_simulators(["idle"], out, backend="kinematic", task=str(without_references))
    assert not out.exists(), "refused before anything is evaluated"


def test_the_table_has_what_was_measured(teams: list[TeamTransfer], out: Path) -> None:
    rows = csv_rows((out / "simulators.csv").read_text())
    found = {
        (row["team"], row["quantity"], row["backend"]): float(row["mean"])
        for row in rows
        if row["task"] == "coop_nav"
    }
    known, new = metric(teams[2], "obstacle_collisions")
    assert found["straight", "obstacle_collisions", "pymunk"] == pytest.approx(known.mean())
    assert found["straight", "obstacle_collisions", "kinematic"] == new.mean() == 0.0
    assert found["idle", "score", "change"] == 0.0
    assert -1.0 <= found["", "rank_correlation", ""] <= 1.0
    assert {row["policies"] for row in rows if row["team"]} == {"1"}
    head = (ROOT / "cards/simulators.csv").read_text().splitlines()[0]
    assert list(rows[0]) == head.split(",")
