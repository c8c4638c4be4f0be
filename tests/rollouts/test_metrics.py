"""Metrics and aggregates against values worked out by hand or by brute force."""

import itertools
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from swarmdata.errors import SchemaError
from swarmdata.registry.components import make_task
from swarmdata.registry.published import Reference, normalized_score
from swarmdata.rollouts import metrics
from swarmdata.rollouts.metrics import bootstrap, episode_metrics, metrics_of
from swarmdata.specs.state_layout import N_COLUMNS, TX
from swarmdata.specs.task_spec import Role, TaskSpec
from swarmdata.types import END_REASONS, Double, Episode, no_messages

SPEC = TaskSpec(team=(Role(count=2),))  # radius 0.12 m, goal radius 0.15 m, dt 0.1 s
TASK = make_task(SPEC)


def episode(**changes: Any) -> Episode:
    """Two robots, three steps: the first drives 0.5 m and 0.5 m and stops, the second waits."""
    states = np.zeros((4, 2, N_COLUMNS), np.float32)
    states[:, 0, :2] = np.array([[0, 0], [0.3, 0.4], [0.6, 0.8], [0.6, 0.8]])
    states[:, 1, :2] = [0.6, 1.3]
    states[:, 0, TX:] = [0.6, 0.9]
    states[:, 1, TX:] = [0.6, 1.46]
    events = np.zeros((3, 2, 4), np.uint8)
    fields: dict[str, Any] = {
        "observations": np.zeros((4, 2, 1), np.float32),
        "states": states.reshape(4, -1),
        "actions": np.zeros((3, 2, 2), np.float32),
        "log_probs": np.zeros((3, 2), np.float32),
        "rewards": np.array([[1, 2], [3, 4], [5, 7]], np.float32),
        "terminations": np.array([False, False, True]),
        "truncations": np.zeros(3, np.bool_),
        "events": events,
        **no_messages(4, 2),
        "layout": np.zeros((0, 8), np.float32),
        "seed": 1,
        "policy": 0,
        "end_reason": END_REASONS.index("success"),
    }
    return Episode(**{**fields, **changes})


def events(*entries: tuple[int, int, int, int]) -> Any:
    out = np.zeros((3, 2, 4), np.uint8)
    for t, robot, column, value in entries:
        out[t, robot, column] = value
    return out


def test_metrics_of_a_clean_success() -> None:
    values = episode_metrics(episode(), TASK)
    assert list(values) == list(metrics_of("coop_nav"))
    assert values["return"] == 1.5 + 3.5 + 6.0
    assert values["success"] == values["clean_success"] == 1.0
    assert values["reached_fraction"] == 0.5  # 0.10 m is within 0.15 m, 0.16 m is not
    assert values["time_to_goal"] == pytest.approx(0.3)
    assert values["length"] == 3
    assert values["robot_collisions"] == values["obstacle_collisions"] == 0
    assert values["contact_steps"] == 0
    assert values["min_separation"] == pytest.approx(0.5 - 0.24, abs=1e-6)
    assert values["path_length"] == pytest.approx((1.0 + 0.0) / 2, abs=1e-6)


def test_a_pair_counts_once_and_a_robot_step_in_two_contacts_once() -> None:
    touching = events((1, 0, 0, 1), (1, 1, 0, 1), (1, 0, 2, 1), (1, 1, 2, 1), (1, 0, 1, 1))
    values = episode_metrics(episode(events=touching), TASK)
    assert values["robot_collisions"] == 1
    assert values["contact_steps"] == 2
    assert (values["success"], values["clean_success"]) == (1, 0)


def test_obstacle_onsets_are_summed_without_wrapping() -> None:
    touching = np.full((3, 2, 4), 200, np.uint8)
    values = episode_metrics(episode(events=touching), TASK)
    assert values["obstacle_collisions"] == 1200
    assert values["robot_collisions"] == 600
    assert values["contact_steps"] == 6


@pytest.mark.parametrize("reason", ["failure", "horizon"])
def test_an_unsolved_episode_has_no_time_to_goal(reason: str) -> None:
    values = episode_metrics(episode(end_reason=END_REASONS.index(reason)), TASK)
    assert math.isnan(values["time_to_goal"])
    assert values["success"] == values["clean_success"] == 0


def test_separation_uses_every_state_and_each_robots_radius() -> None:
    states = episode().states.copy()
    states[2, N_COLUMNS : N_COLUMNS + 2] = [0.6, 1.0]  # 0.2 m apart, in an intermediate state only
    small = SPEC.team[0].robot.model_copy(update={"radius": 0.05})
    spec = TaskSpec(team=(Role(count=1), Role(name="small", count=1, robot=small)))
    values = episode_metrics(episode(states=states), make_task(spec))
    assert values["min_separation"] == pytest.approx(0.2 - 0.17, abs=1e-6)


def test_one_robot_has_no_separation() -> None:
    alone = episode()
    alone = replace(
        alone,
        states=alone.states[:, :N_COLUMNS],
        events=alone.events[:, :1],
        rewards=alone.rewards[:, :1],
    )
    task = make_task(TaskSpec(team=(Role(count=1),)))
    assert math.isnan(episode_metrics(alone, task)["min_separation"])


def test_states_of_another_team_are_refused() -> None:
    with pytest.raises(SchemaError, match=r"states are \[4, 16\], expected at least \[..., 32\]"):
        episode_metrics(episode(), make_task(TaskSpec()))


def test_score_is_0_without_skill_and_100_for_the_expert() -> None:
    reference = Reference(no_skill=-2.0, expert=8.0)
    scores = normalized_score(np.array([-2.0, 8.0, 3.0, 13.0, -12.0]), reference)
    assert scores.tolist() == [0, 100, 50, 150, -100]
    with pytest.raises(SchemaError, match="no_skill=1, expert=1"):
        normalized_score(0.0, Reference(1.0, 1.0))


def test_restricted_mean_counts_failures_as_the_limit() -> None:
    times = np.array([2.0, 4.0, np.nan, np.nan])
    assert metrics.restricted_mean_time(times, 16.0) == (2 + 4 + 16 + 16) / 4
    survival = [np.nan_to_num(times, nan=99.0) > t for t in np.arange(0, 16, 0.01)]
    area = np.mean(survival, axis=1).sum() * 0.01
    assert metrics.restricted_mean_time(times, 16.0) == pytest.approx(area, abs=0.02)


@pytest.mark.parametrize(
    ("scores", "expected"),
    [
        ([[7.0]], 7.0),
        ([[1.0], [2.0], [9.0]], 4.0),  # floor(3 / 4) = 0 are dropped
        ([[100.0], [2.0], [3.0], [-50.0]], 2.5),
        ([[5.0], [1.0], [4.0], [2.0], [90.0]], (2 + 4 + 5) / 3),
        ([[8.0, 1.0, 2.0, 7.0], [3.0, 6.0, 5.0, 4.0]], 4.5),
    ],
)
def test_iqm_by_hand(scores: list[list[float]], expected: float) -> None:
    assert metrics.iqm(np.array(scores)) == pytest.approx(expected)


TABLES = arrays(
    np.float64,
    st.tuples(st.integers(1, 9), st.integers(1, 4)),
    elements=st.floats(-1e3, 1e3),
)


@given(TABLES)
@settings(deadline=None)
def test_aggregates_equal_their_definitions(table: Double) -> None:
    flat = sorted(table.ravel().tolist())
    cut = len(flat) // 4
    middle = flat[cut : len(flat) - cut]
    assert metrics.iqm(table) == pytest.approx(sum(middle) / len(middle), abs=1e-9)
    assert metrics.mean(table) == pytest.approx(sum(flat) / len(flat), abs=1e-9)
    gap = sum(100.0 - min(v, 100.0) for v in flat) / len(flat)
    assert metrics.optimality_gap(table) == pytest.approx(gap, abs=1e-9)
    stacked = np.stack([table, table + 1.0])
    for aggregate in (metrics.iqm, metrics.mean, metrics.optimality_gap):
        assert aggregate(stacked).shape == (2,)
        assert aggregate(stacked)[0] == pytest.approx(float(aggregate(table)), abs=1e-9)


def test_probability_of_improvement_by_brute_force() -> None:
    x = np.array([[1.0, 5.0], [2.0, 5.0], [3.0, 0.0]])
    y = np.array([[2.0, 5.0], [0.0, 1.0]])
    wins = [
        1.0 if a > b else 0.5 if a == b else 0.0
        for task in range(2)
        for a, b in itertools.product(x[:, task], y[:, task])
    ]
    assert metrics.probability_of_improvement(x, y) == pytest.approx(np.mean(wins))
    assert metrics.probability_of_improvement(x, x) == 0.5


def exact_bootstrap(table: Double) -> Double:
    """The mean over every equally likely stratified resample."""
    draws = list(itertools.product(range(len(table)), repeat=len(table)))
    per_task = [[column[list(rows)].mean() for rows in draws] for column in table.T]
    return np.array([np.mean(combination) for combination in itertools.product(*per_task)])


def test_bootstrap_agrees_with_every_possible_resample() -> None:
    table = np.array([[0.0, 10.0], [1.3, 14.0], [4.1, 11.0]])
    exact = exact_bootstrap(table)
    assert len(exact) == 27**2
    found = bootstrap(metrics.mean, table, generator=np.random.default_rng(0), n_resamples=40_000)
    assert found.value == pytest.approx(table.mean())
    np.testing.assert_allclose(found[1:], np.quantile(exact, [0.025, 0.975]), atol=0.06)


def test_bootstrap_never_mixes_tasks_and_draws_them_independently() -> None:
    table = np.array([[0.0, 100.0], [1.0, 101.0]])
    sums: list[Double] = []

    def keep(resampled: Double) -> Double:
        sums.append(resampled)
        return metrics.mean(resampled)

    bootstrap(keep, table, generator=np.random.default_rng(0), n_resamples=400)
    drawn = sums[0]
    assert drawn.shape == (400, 2, 2)
    assert set(np.unique(drawn[..., 0])) == {0.0, 1.0}
    assert set(np.unique(drawn[..., 1])) == {100.0, 101.0}
    independent = (drawn[..., 0] == drawn[..., 1] - 100.0).mean()
    assert 0.4 < independent < 0.6


def test_bootstrap_is_a_function_of_the_generator_and_of_no_chunking(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    table = np.random.default_rng(3).normal(size=(6, 3))

    def run() -> metrics.Estimate:
        return bootstrap(metrics.iqm, table, generator=np.random.default_rng(1), n_resamples=501)

    whole = run()
    monkeypatch.setattr(metrics, "MAX_RESAMPLED_SCORES", 100)
    assert run() == whole


def test_bootstrap_of_two_tables_resamples_both() -> None:
    rng = np.random.default_rng(5)
    x, y = rng.normal(1.0, 1.0, (10, 1)), rng.normal(0.0, 1.0, (7, 1))
    found = bootstrap(metrics.probability_of_improvement, x, y, generator=rng)
    assert found.low < found.value < found.high <= 1.0
    assert found.value > 0.5


def test_bootstrap_covers_the_true_mean() -> None:
    rng = np.random.default_rng(11)
    hits = 0
    for _ in range(200):
        low, high = bootstrap(
            metrics.mean, rng.normal(size=(60, 1)), generator=rng, n_resamples=400
        )[1:]
        hits += low <= 0.0 <= high
    assert 180 <= hits <= 199  # 95 % of 200, with room for five standard deviations below


@pytest.mark.parametrize("table", [np.zeros((0, 1)), np.zeros(3), np.array([[np.nan]])])
def test_bootstrap_refuses_what_is_not_a_finite_table(table: Double) -> None:
    with pytest.raises(SchemaError, match=r"expected finite \[runs, tasks\]"):
        bootstrap(metrics.mean, table, generator=np.random.default_rng(0))


def test_wilson_interval_solves_its_equation() -> None:
    z = 1.959963984540054
    for k, n in [(0, 10), (1, 10), (500, 1000), (987, 1000), (1000, 1000)]:
        rate, low, high = metrics.wilson_interval(k, n)
        assert 0.0 <= low <= rate <= high <= 1.0
        for end in {low, high} - {0.0, 1.0}:
            assert abs(rate - end) == pytest.approx(z * math.sqrt(end * (1 - end) / n))
    # Brown, Cai and DasGupta 2001: for 0 successes the upper end is z^2 / (n + z^2)
    assert metrics.wilson_interval(0, 10).high == pytest.approx(z * z / (10 + z * z))


@pytest.mark.parametrize(("k", "n"), [(-1, 5), (6, 5), (0, 0)])
def test_wilson_interval_refuses_impossible_counts(k: int, n: int) -> None:
    with pytest.raises(SchemaError, match="expected 0 <= successes <= episodes"):
        metrics.wilson_interval(k, n)
