"""Policies in two simulators: the same seeds, paired tables, ranks, and what is refused."""

import csv
import io
from pathlib import Path

import numpy as np
import pytest

from swarmdata.errors import SpecError, UnknownNameError
from swarmdata.evaluation.transfer.simulator_transfer import (
    TeamTransfer,
    plan_transfer,
    rank_agreement,
    run_transfer,
    transfer_table,
)

ROOT = Path(__file__).parents[3]

NAMES = ("idle", "random", "straight")


@pytest.fixture(scope="module")
def teams(tmp_path_factory: pytest.TempPathFactory) -> list[TeamTransfer]:
    folder = tmp_path_factory.mktemp("results")
    planned = plan_transfer(NAMES, ["coop_nav"], folder, backend="kinematic", n_episodes=3)
    return run_transfer(planned, progress=False)


def test_both_simulators_play_the_same_episodes(teams: list[TeamTransfer]) -> None:
    assert [team.label for team in teams] == list(NAMES)
    for team in teams:
        assert team.backends == ("pymunk", "kinematic")
        (known,), (new,) = team.known, team.new
        np.testing.assert_array_equal(known.evaluation.seeds, new.evaluation.seeds)
        assert known.spec.world is not None
        assert new.spec == known.spec.world.with_updates(backend="kinematic")
        assert new.evaluation.spec_hash != known.evaluation.spec_hash
    idle, _, straight = teams
    np.testing.assert_array_equal(*idle.metric("length"))
    before, after = straight.metric("obstacle_collisions")
    assert before.shape == after.shape == (1, 3)
    assert before.sum() > after.sum() == 0.0, "nothing touches anything without contacts"


def test_scores_are_on_the_scale_of_the_first(teams: list[TeamTransfer]) -> None:
    known, new = teams[0].scores()
    np.testing.assert_array_equal(known, new)  # idle robots: the same return, the same scale
    found = rank_agreement(teams)
    assert found is not None
    assert -1.0 <= found.low <= found.value <= found.high <= 1.0
    assert rank_agreement(teams[:2]) is None


def test_an_interrupted_transfer_resumes(tmp_path: Path) -> None:
    planned = plan_transfer(["idle"], ["coop_nav"], tmp_path, backend="kinematic", n_episodes=2)
    run_transfer(planned, progress=False)
    written = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.json")}
    assert len(written) == 2
    run_transfer(planned, progress=False)
    assert written == {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.json")}


def test_what_cannot_be_compared_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SpecError, match="simulated by pymunk already"):
        plan_transfer(["idle"], ["coop_nav"], tmp_path, backend="pymunk")
    with pytest.raises(UnknownNameError, match="Did you mean 'mujoco'"):
        plan_transfer(["idle"], ["coop_nav"], tmp_path, backend="mujoko")


def test_the_table_has_what_was_measured(teams: list[TeamTransfer]) -> None:
    rows = list(csv.DictReader(io.StringIO(transfer_table(teams))))
    found = {
        (row["team"], row["quantity"], row["backend"]): float(row["mean"])
        for row in rows
        if row["task"] == "coop_nav"
    }
    known, new = teams[2].metric("obstacle_collisions")
    assert found["straight", "obstacle_collisions", "pymunk"] == pytest.approx(known.mean())
    assert found["straight", "obstacle_collisions", "kinematic"] == new.mean() == 0.0
    assert found["idle", "score", "change"] == 0.0
    assert -1.0 <= found["", "rank_correlation", ""] <= 1.0
    assert {row["policies"] for row in rows if row["team"]} == {"1"}
    head = (ROOT / "cards/simulators.csv").read_text().splitlines()[0]
    assert list(rows[0]) == head.split(",")
