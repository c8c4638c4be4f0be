"""The numbers of docs/coordination.md are those of the measured references."""

import re
from pathlib import Path

import numpy as np
import pytest

from swarmdata.registry.components import make_env, make_policy
from swarmdata.registry.published import Interval, references
from swarmdata.registry.recipes import FAMILY_SPECS, checkpoints
from swarmdata.specs.state_layout import VX, VY, X, Y, robots_of
from tests.docs.marked_numbers import MARK, faults

PAGE = Path(__file__).parents[2] / "docs" / "coordination.md"

GAPS, LEARNERS = PAGE.read_text("utf-8").split("## Do learners")

ROWS = re.findall(r"^\| `([^`]+)` \|( \d.*)\|$", GAPS, re.MULTILINE)


def percent(value: Interval | None) -> str:
    assert value is not None
    return f"{100 * value.value:.1f}".replace("-0.0", "0.0")


@pytest.mark.parametrize(("preset", "cells"), ROWS)
def test_a_row_has_what_was_measured(preset: str, cells: str) -> None:
    known = references()[preset]
    gaps = [known.gaps.get(f"scripted-{name}") for name in ("alone", "naive", "deaf")]
    expected = [
        percent(known.policies["scripted"]["success"]),
        *("" if gap is None else percent(gap["success"]) for gap in gaps),
        percent(known.gaps["scripted-alone"]["clean_success"]),
    ]
    assert [cell.strip() for cell in cells.split("|")] == expected


def test_scores_of_learners_are_those_of_the_study() -> None:
    assert len(MARK.findall(LEARNERS)) == 122
    assert not list(faults(LEARNERS, PAGE.parents[1] / "cards/studies"))


def test_the_best_naive_team_of_pursuit() -> None:
    teams = [name for name in references()["pursuit"].policies if name.startswith("pursuit-")]
    shares = {name: references()["pursuit"].policies[name]["success"] for name in teams}
    best = max(shares, key=lambda name: float(percent(shares[name])))
    assert best == "pursuit-lead-3"
    text = PAGE.read_text("utf-8").replace("\n  ", " ")
    assert f"solves {percent(shares[best])} %" in text
    naive = references()["pursuit"].gaps["scripted-naive"]["clean_success"]
    assert f"cleanly: {percent(naive)} points" in text


@pytest.mark.parametrize(("tier", "sides"), [("medium", (4, 2)), ("expert", (3, 1))])
def test_the_sides_to_which_learned_teams_turn(tier: str, sides: tuple[int, int]) -> None:
    spec = FAMILY_SPECS["coop_nav-swap-strict"]
    turns = []
    for shipped in checkpoints("coop_nav-swap-strict", tier):
        policy = make_policy("learned", spec, checkpoint=shipped.file, sha256=shipped.sha256)
        env = make_env(spec, 4)
        step = env.reset(np.arange(4, dtype=np.uint64))
        policy.reset(step, np.arange(4))
        turn = np.zeros(4)
        for _ in range(30):
            step = env.step(policy.act(step))
            robots = robots_of(step.states, spec.n_agents)
            turn += (robots[..., X] * robots[..., VY] - robots[..., Y] * robots[..., VX]).sum(-1)
        assert len(set(np.sign(turn))) == 1, "in all episodes to the same side"
        turns.append(turn[0] > 0)
    assert (sum(turns), len(turns) - sum(turns)) == sides
    said = {"medium": "four and two of those of `medium`", "expert": "three and one of the experts"}
    assert said[tier] in " ".join(PAGE.read_text("utf-8").split())


def test_what_robots_that_ignore_each_other_solve_in_coop_nav() -> None:
    alone = references()["coop_nav"].policies["scripted-alone"]
    text = " ".join(PAGE.read_text("utf-8").split())
    assert f"{percent(alone['success'])} % of the episodes are solved" in text
    assert f"{percent(alone['clean_success'])} % cleanly" in text
