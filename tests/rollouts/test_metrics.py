"""Metrics of episodes against values worked out by hand."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from swarmdata.errors import SchemaError
from swarmdata.registry.components import make_task
from swarmdata.registry.published import Reference, normalized_score
from swarmdata.rollouts import metrics
from swarmdata.rollouts.metrics import episode_metrics, metrics_of
from swarmdata.specs.state_layout import N_COLUMNS, TX
from swarmdata.specs.task_spec import Role, TaskSpec
from swarmdata.types import END_REASONS, Episode
from tests.support.made_episodes import made_episode

SPEC = TaskSpec(team=(Role(count=2),))  # radius 0.12 m, goal radius 0.15 m, dt 0.1 s
TASK = make_task(SPEC)


def episode(**changes: Any) -> Episode:
    """Two robots, three steps: the first drives 0.5 m and 0.5 m and stops, the second waits."""
    states = np.zeros((4, 2, N_COLUMNS), np.float32)
    states[:, 0, :2] = np.array([[0, 0], [0.3, 0.4], [0.6, 0.8], [0.6, 0.8]])
    states[:, 1, :2] = [0.6, 1.3]
    states[:, 0, TX:] = [0.6, 0.9]
    states[:, 1, TX:] = [0.6, 1.46]
    seen, actions, rewards = np.zeros((4, 2, 1)), np.zeros((3, 2, 2)), [[1, 2], [3, 4], [5, 7]]
    made = made_episode(seen, states.reshape(4, -1), actions, rewards, ends=True, seed=1)
    return replace(made, **changes)


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


def test_censored_times_count_failures_as_the_limit() -> None:
    times = np.array([2.0, 4.0, np.nan, np.nan])
    mean = metrics.censored_times(times, 16.0).mean()
    assert mean == (2 + 4 + 16 + 16) / 4
    survival = [np.nan_to_num(times, nan=99.0) > t for t in np.arange(0, 16, 0.01)]
    area = np.mean(survival, axis=1).sum() * 0.01
    assert mean == pytest.approx(area, abs=0.02)
