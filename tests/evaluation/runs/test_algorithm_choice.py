"""`train auto`: statistics by hand, the rule, and what it would have lost on measured datasets."""

from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from swarmdata.datasets.dataset import Dataset
from swarmdata.datasets.mixture import mix
from swarmdata.errors import SpecError
from swarmdata.evaluation.runs.algorithm_choice import (
    MATD3_COMMON,
    MATD3_ROBOTS,
    MATD3_STEPS,
    STATISTICS,
    THRESHOLDS,
    EpisodeStatistics,
    choose_algorithm,
    choose_for,
)
from swarmdata.registry.presets import preset
from swarmdata.rollouts.score_statistics import wilson_interval
from swarmdata.specs.recipe import PolicySource
from swarmdata.specs.task_spec import TaskSpec
from tests.benchmarks import measuring
from tests.benchmarks.fit_auto import (
    EVERYWHERE,
    Row,
    choices,
    fit,
    fit_matd3,
    read_later_rows,
    read_rows,
    regrets,
    report,
    rounded,
    table_of_datasets,
)
from tests.benchmarks.fit_auto import chosen as chosen_by
from tests.benchmarks.measuring import long_tables_as_files
from tests.support.tiny import make_tiny

SCRIPTED = (PolicySource(label="a", name="scripted"),)


class Table(SimpleNamespace):
    """The columns of a table of episodes that the statistics are of."""

    def __len__(self) -> int:
        return len(self.policy)


def data(returns: Any, policy: Any, success: Any) -> Any:
    """Episodes of one step, with the returns of each robot, [n, N]."""
    rewards = np.asarray(returns, dtype=np.float32)
    table = Table(
        policy=np.asarray(policy, dtype=np.uint8),
        success=np.asarray(success, dtype=bool),
        team_return=rewards.mean(axis=1, dtype=np.float64),
    )
    return SimpleNamespace(id="x", episodes=table, read=lambda _: ((row[None],) for row in rewards))


def of(returns: Any, policy: Any = None, success: Any = None) -> EpisodeStatistics:
    n = len(returns)
    policy = np.zeros(n) if policy is None else policy
    return EpisodeStatistics.of(data(returns, policy, np.zeros(n) if success is None else success))


def test_returns_are_common_if_robots_get_the_same_and_not_if_they_are_independent() -> None:
    rng = np.random.default_rng(0)
    team, own = rng.normal(size=(4000, 1)), rng.normal(size=(4000, 4))
    roles = np.array([5.0, 0.0, -3.0, 1.0])  # constant differences of robots are no variance
    assert of(np.repeat(team, 4, axis=1) + roles).common_reward == pytest.approx(1.0, abs=1e-6)
    assert of(own + roles).common_reward < 0.05
    assert of(team + own).common_reward == pytest.approx(0.5, abs=0.05)
    assert of(own[:, :1]).common_reward == 0.0  # a robot alone
    assert of(np.ones((5, 3))).common_reward == 0.0


def test_the_best_policy_is_that_which_solves_the_most_of_its_own_episodes_for_certain() -> None:
    policy, success = np.repeat([0, 2], [100, 2]), np.repeat([1, 0, 1], [60, 40, 2])
    found = of(np.zeros((102, 2)), policy, success).best_success
    assert found == wilson_interval(60, 100).low > wilson_interval(2, 2).low


def test_the_shift_is_between_the_policies_of_the_best_and_of_all() -> None:
    policy = np.repeat([0, 1], 500)
    apart = np.linspace(0, 1, 1000)[:, None].repeat(2, axis=1)
    assert of(apart, policy).best_shift == pytest.approx(0.5, abs=0.05)  # all by policy 1
    shuffled = np.random.default_rng(1).permutation(apart)
    assert of(shuffled, policy).best_shift < 0.05
    assert of(apart).best_shift == 0.0  # one policy


@pytest.mark.parametrize(
    ("common", "success", "shift", "expected"),
    [
        (0.2, 0.3, 0.1, "iql"),
        (0.2, 0.3, 0.4, "matd3"),
        (0.2, 0.97, 0.4, "filtered_bc"),
        (0.2, 0.97, 0.0, "bc"),
        (0.9, 0.3, 0.0, "filtered_bc"),
        (0.9, 0.97, 0.4, "filtered_bc"),
        (0.9, 0.97, 0.0, "bc"),
    ],
)
def test_the_rule(common: float, success: float, shift: float, expected: str) -> None:
    choice = choose_algorithm(EpisodeStatistics(common, success, shift))
    assert choice.algorithm == expected
    assert choice.doubts == ()
    assert choice.line.startswith(f"auto takes {expected}: ")


def test_values_stay_close_to_the_data_where_robots_share_more_than_was_measured() -> None:
    found = EpisodeStatistics(common_reward=MATD3_COMMON + 0.001, best_success=0.3, best_shift=0.4)
    choice = choose_algorithm(found)
    assert choice.algorithm == "iql"
    assert "matd3 is not known to be safe above 47 %" in choice.line
    assert choose_algorithm(found, matd3_common=0.5).algorithm == "matd3"


def test_where_a_contact_ends_the_episode_values_are_learned_close_to_the_data() -> None:
    found = EpisodeStatistics(common_reward=0.2, best_success=0.3, best_shift=0.4)
    choice = choose_algorithm(found, contact_ends=True)
    assert choice.algorithm == "maddpg_bc"
    assert "a contact ends the episode" in choice.line
    for other in (replace(found, common_reward=0.9), replace(found, best_success=0.9)):
        assert choose_algorithm(other, contact_ends=True) == choose_algorithm(other)


@pytest.mark.parametrize(
    ("rule", "n_robots", "n_steps", "expected", "reason"),
    [
        ("fail", 4, MATD3_STEPS, "maddpg_bc", "a contact ends the episode"),
        ("continue", 4, MATD3_STEPS, "matd3", "differ from those of all"),
        ("continue", MATD3_ROBOTS + 1, MATD3_STEPS, "iql", "more than 8 robots, got 9"),
        ("continue", 4, MATD3_STEPS - 1, "iql", "needs 500,000 joint steps, got 499,999"),
    ],
)
def test_rule_and_sizes_of_the_data_decide_which_values_are_learned(
    rule: str, n_robots: int, n_steps: int, expected: str, reason: str
) -> None:
    n = 400
    returns = np.random.default_rng(0).normal(size=(n, n_robots))
    best = returns.mean(axis=1) > np.quantile(returns.mean(axis=1), 0.9)
    found = data(returns, best, np.zeros(n))  # the best episodes are by another policy
    found.split = lambda name: found
    found.n_steps = n_steps
    world = TaskSpec.parse({"on_collision": rule})
    found.spec = SimpleNamespace(world=world, n_agents=n_robots)
    choice = choose_for(found)
    assert choice.algorithm == expected
    assert reason in choice.line


def test_what_no_measured_dataset_tells_apart_is_said() -> None:
    sure = {"common_reward": 0.1, "best_success": 1.0, "best_shift": 0.5}
    for name in STATISTICS:
        other = {**sure, "best_success": 0.1} if name == "common_reward" else sure
        between = EpisodeStatistics(**{**other, name: THRESHOLDS[name].middle})
        (doubt,) = choose_algorithm(between).doubts
        assert f"no measured dataset has a {name.replace('_', ' ')} between" in doubt
    poor = EpisodeStatistics(0.1, 0.1, THRESHOLDS["best_shift"].middle)
    assert "so iql and matd3 are not told apart" in choose_algorithm(poor).line
    # an expert is cloned whatever robots share
    clear = EpisodeStatistics(**{**sure, "common_reward": THRESHOLDS["common_reward"].middle})
    assert choose_algorithm(clear).doubts == ()
    assert "if success was not recorded" in choose_algorithm(EpisodeStatistics(0, 0, 0)).line


@cache
def chosen() -> tuple[list[Row], dict[str, list[str]]]:
    """The measured datasets, and what each way of choosing takes on them."""
    rows = read_rows()
    return rows, choices(rows)


def test_thresholds_are_fitted_to_published_scores_and_only_random_data_leave_doubts() -> None:
    rows = read_rows()
    fitted = fit(rows)
    assert {name: rounded(each) for name, each in fitted.items()} == THRESHOLDS
    assert fit_matd3(rows, fitted) <= MATD3_COMMON < fit_matd3(rows, fitted) + 0.01
    assert list(fitted) == list(STATISTICS)
    found = {
        row.dataset: choose_algorithm(row.statistics, contact_ends=row.contact_ends) for row in rows
    }
    doubtful = [name for name, choice in found.items() if choice.doubts]
    assert doubtful == ["coop_nav-random"]


@pytest.mark.slow
def test_left_out_datasets_lose_little() -> None:
    """The goal: a regret of 2 on average, and of at most 10 on any dataset."""
    rows, picked = chosen()
    found = {way: regrets(rows, names) for way, names in picked.items()}
    auto = found["auto, leave one dataset out"]
    assert len(rows) == 32
    five = np.array(found["best of the five"])
    assert np.mean(np.array(auto) - five) <= 2
    assert max(np.array(auto) - five) <= 10
    fixed = [np.mean(np.array(found[f"always `{name}`"]) - five) for name in EVERYWHERE]
    assert np.mean(np.array(auto) - five) < min(fixed) / 3
    assert np.mean(five) <= np.mean(auto)


def test_the_page_of_measurements_has_these_tables(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = measuring.PAGE.read_text(encoding="utf-8")
    committed = {file.name: file.read_bytes() for file in measuring.TABLES.iterdir()}
    monkeypatch.setattr(measuring, "TABLES", tmp_path / "measurements")
    tables = long_tables_as_files("Choosing an algorithm", report(*chosen()))
    ways, datasets = tables.split("\n\n")
    assert ways.strip() in page
    assert datasets.strip() in page, "a link"
    (file,) = measuring.TABLES.iterdir()
    assert file.read_bytes() == committed[file.name]


def test_pages_quote_these_regrets() -> None:
    rows, picked = chosen()
    lost = {way: regrets(rows, names) for way, names in picked.items()}
    dataset, task = lost["auto, leave one dataset out"], lost["auto, leave one task out"]
    clones = lost["always `filtered_bc`"]
    later = read_later_rows()
    picked_later = list(map(chosen_by, later))
    lost_later = regrets(later, picked_later)
    assert table_of_datasets(later, picked_later).strip() in measuring.PAGE.read_text("utf-8")
    learning, claims = (
        " ".join((measuring.PAGE.parent / name).read_text(encoding="utf-8").split())
        for name in ("learning.md", "results/claims.md")
    )
    beside_five = np.array(dataset) - lost["best of the five"]
    assert f"its five, {beside_five.mean():.1f} and {beside_five.max():.1f}." in learning
    assert (
        f"the choice loses {np.mean(dataset):.1f} points on average against the best of all "
        f"algorithms, and {max(dataset):.1f} at most"
    ) in learning
    assert f"it loses {np.mean(task):.1f} and {max(task):.1f}:" in learning
    assert f"not part of the fit, `auto` loses at most {max(lost_later):.0f} points" in claims
    assert f"`swarmdata train auto` is {np.mean(dataset):.0f} points below the best" in claims
    assert f"at worst {max(dataset):.0f}, on" in claims
    assert f"alone is {np.mean(clones):.0f} below, at worst {max(clones):.0f}." in claims
    assert f"`auto` is {np.mean(task):.0f} below, at worst {max(task):.0f}, on" in claims


def test_few_episodes_are_not_certain_and_without_differences_of_returns_are_cloned(
    tiny: Path,
) -> None:
    dataset = Dataset.open(tiny)
    assert "episodes are few" in choose_for(dataset).line
    weights = {name: 0.0 for name, _ in dataset.task.rules.rewards}
    choice = choose_for(dataset.with_rewards(**weights))
    assert (choice.algorithm, choice.doubts) == ("bc", ())
    assert "the same return" in choice.line


def test_opponents_leave_a_doubt(tmp_path: Path) -> None:
    spec = preset("tag").with_updates(horizon=20)
    data = make_tiny(tmp_path / "tag-tiny-v0", id="tag-tiny-v0", spec=spec, policies=SCRIPTED)
    assert "Not certain: the rule was measured without opponents" in (
        choose_for(Dataset.open(data).side("pursuers")).line
    )


def test_mixtures_and_no_episodes_are_refused(tiny: Path) -> None:
    dataset = Dataset.open(tiny)
    with pytest.raises(SpecError, match="one dataset, got a mixture"):
        choose_for(mix([dataset, dataset], [1.0, 2.0]))
    with pytest.raises(SpecError, match="no episodes"):
        choose_for(dataset.filter(min_return=1e9))
