"""Tag: sides, starts, captures, rewards of zero sum, and who succeeds."""

from typing import Any

import numpy as np
import pytest

from swarmdata.envs.tag.tag import Tag
from swarmdata.errors import SpecError, UnknownNameError
from swarmdata.registry.components import make_env, make_policy, make_task, reward_terms
from swarmdata.registry.presets import preset
from swarmdata.rollouts.metrics import episode_metrics
from swarmdata.rollouts.rollout import rollout
from swarmdata.specs.state_layout import TX, VX, VY, Y, robots_of
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Episode

SPEC = preset("tag")
SEEDS = np.arange(6, dtype=np.uint64)


def with_team(*team: dict[str, Any]) -> TaskSpec:
    return SPEC.with_updates(team=list(team))


@pytest.fixture(scope="module")
def episodes() -> list[Episode]:
    """Most are won by pursuers, some by the evader: their horizon is short."""
    spec = SPEC.with_updates(horizon=130)
    return list(rollout(make_env(spec, 6), make_policy("scripted", spec), SEEDS))


def test_a_team_is_of_two_sides() -> None:
    pursuers, evader = SPEC.sides
    assert (pursuers.name, list(pursuers.agents)) == ("pursuers", [0, 1, 2])
    assert (evader.name, list(evader.agents)) == ("evader", [3])
    assert SPEC.side("evader") == evader
    assert SPEC.side_bounds == (0, 3, 4)
    with pytest.raises(UnknownNameError, match=r"unknown side 'evaders'. Did you mean 'evader'\?"):
        SPEC.side("evaders")


def test_other_tasks_have_one_side() -> None:
    spec = preset("coop_nav")
    assert spec.side_bounds == (0, spec.n_agents)
    with pytest.raises(SpecError, match="coop_nav has one side, got side 'pursuers'"):
        spec.side("pursuers")


def test_teams_and_ends_without_a_winner_are_refused() -> None:
    pursuer, evader = {"name": "pursuer", "count": 3}, {"name": "evader", "count": 1}
    assert Tag(with_team({**pursuer, "count": 2}, {"name": "scout", "count": 1}, evader))
    for team in ([pursuer], [evader], [evader, pursuer], [pursuer, {**evader, "count": 2}]):
        with pytest.raises(SpecError, match="expected roles of pursuers, and then 1 x evader"):
            Tag(with_team(*team))
    with pytest.raises(SpecError, match="captors is 3 in a team of 2 robots"):
        Tag(with_team({**pursuer, "count": 2}, evader))
    slow = {**pursuer, "robot": {"max_speed": 1e-3}}
    with pytest.raises(SpecError, match="in the team of tag: speed_ratio: expected at most 1000"):
        Tag(with_team(slow, {**evader, "robot": {"max_speed": 1.2}}))
    with pytest.raises(SpecError, match="on_collision fail ends an episode in which no side"):
        SPEC.with_updates(on_collision="fail")


@pytest.mark.parametrize("dynamics", ["holonomic", "unicycle"])
def test_pursuers_start_in_a_corner_and_the_evader_away_from_them(dynamics: str) -> None:
    robot = {"radius": 0.1, "dynamics": dynamics}
    spec = with_team({"name": "pursuer", "count": 3, "robot": robot},
                     {"name": "evader", "count": 1, "robot": robot})  # fmt: skip
    env = make_env(spec, 6)
    env.reset(SEEDS)
    step = env.reset(SEEDS[:2], np.array([4, 1]))
    robots = robots_of(step.states, 4).astype(np.float64)
    gaps = np.linalg.norm(robots[:, :3, : Y + 1] - robots[:, 3:, : Y + 1], axis=-1)
    assert gaps.min() >= spec.spawn.min_goal_distance - 1e-5
    assert (np.abs(robots[:, :3, : Y + 1]) >= 1.0).all()
    np.testing.assert_allclose(np.hypot(robots[..., 4], robots[..., 5]), 1.0, atol=1e-6)
    np.testing.assert_array_equal(robots[..., TX:], robots[:, [3] * 4, : Y + 1])
    alone = make_env(spec, 1).reset(SEEDS[:1])
    np.testing.assert_array_equal(step.states[4], alone.states[0])


def test_a_capture_ends_it_and_the_horizon_is_the_evaders(episodes: list[Episode]) -> None:
    task = make_task(SPEC)
    success = [term.name for term in reward_terms(task)].index("success")
    for episode in episodes:
        robots = robots_of(episode.states, 4)[..., : Y + 1].astype(np.float64)
        near = np.linalg.norm(robots[1:, :3] - robots[1:, 3:], axis=-1) <= 0.45
        assert episode.reward_terms is not None
        captured = near.sum(1) == 3
        assert captured[:-1].sum() == 0
        assert captured[-1] == episode.terminations[-1] == episode.success
        won = episode.reward_terms[..., success]
        assert not won[:-1].any()
        assert won[-1].tolist() == [episode.success] * 3 + [not episode.success]
        found = episode_metrics(episode, task)
        assert found["pursuers_success"] == episode.success == 1 - found["evader_success"]
        own = episode.rewards.astype(np.float64).sum(0)
        assert found["pursuers_return"] == pytest.approx(own[:3].mean(), abs=1e-5)
        assert found["evader_return"] == pytest.approx(own[3], abs=1e-5)
        assert (found["tightest_ring"] <= 0.45) == episode.success
    assert {episode.success for episode in episodes} == {True, False}


def test_the_share_of_the_team_is_that_of_the_side() -> None:
    rewards = {**SPEC.rules.model_dump()["rewards"], "team_share": 1.0}
    spec = SPEC.with_updates(rules={**SPEC.rules.model_dump(), "rewards": rewards}, horizon=20)
    for episode in rollout(make_env(spec, 2), make_policy("scripted", spec), SEEDS[:2]):
        assert (episode.rewards[:, :3] == episode.rewards[:, :1]).all()
        assert (episode.rewards[:, 3] != episode.rewards[:, 0]).any()


def test_observations_tell_the_evader_from_the_pursuers() -> None:
    env = make_env(SPEC, 2)
    step = env.reset(SEEDS[:2])
    for _ in range(5):
        step = env.step(np.full((2, 4, 2), 0.5))
    names = [feature.name for feature in env.features]
    is_evader = step.observations[..., names.index("is_evader")]
    assert is_evader.tolist() == [[0, 0, 0, 1]] * 2
    first = names.index("evader.velocity_x")
    expected = robots_of(step.states, 4)[:, [3] * 4, VX : VY + 1]
    np.testing.assert_array_equal(step.observations[..., first : first + 2], expected)
