"""The pushing controller: it succeeds, and an episode is the same in any batch."""

from typing import Any

import numpy as np
import pytest

from swarmdata.behavior_policies.transport.transport_controller import TransportController
from swarmdata.errors import SpecError
from swarmdata.numerics.random import evaluation_seeds
from swarmdata.registry.components import make_env, make_policy
from swarmdata.registry.presets import preset
from swarmdata.rollouts.rollout import rollout
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Episode

DEFAULT = preset("transport")
BOX = {"task": "transport", "payload": {"shape": "box"}}


def team(count: int = 4, **robot: Any) -> list[dict[str, Any]]:
    return [{"count": count, "robot": robot}]


def play(spec: TaskSpec, n_episodes: int, n_copies: int = 8, noise: float = 0.0) -> list[Episode]:
    policy = make_policy("scripted", spec, noise=noise)
    seeds = evaluation_seeds(n_episodes)
    return list(rollout(make_env(spec, n_copies), policy, seeds))


def share(episodes: list[Episode]) -> float:
    return float(np.mean([episode.success for episode in episodes]))


@pytest.mark.parametrize(
    ("name", "n_episodes", "least"),
    [
        ("transport", 24, 0.95),
        ("transport-easy", 8, 0.99),
        ("transport-n3", 12, 0.8),
        ("transport-n8", 8, 0.8),
        ("transport-hard", 16, 0.6),
    ],
)
def test_it_brings_the_payload_to_its_goal(name: str, n_episodes: int, least: float) -> None:
    assert share(play(preset(name), n_episodes)) >= least


def test_robots_with_acceleration_commands_and_of_different_sizes_push_too() -> None:
    small = {"radius": 0.09, "command": "acceleration"}
    mixed = DEFAULT.with_updates(team=[*team(2), {"name": "small", "count": 2, "robot": small}])
    assert share(play(mixed, 10)) >= 0.8


def test_it_says_which_robots_and_goals_it_cannot_serve() -> None:
    with pytest.raises(SpecError, match="robot_0 has unicycle dynamics"):
        TransportController(DEFAULT.with_updates(team=team(dynamics="unicycle")))
    with pytest.raises(SpecError, match=r"goal_angle is 0\.2"):
        TransportController(DEFAULT.with_updates(rules={**BOX, "goal_angle": 0.2}))
    with pytest.raises(SpecError, match="expected 'transport'"):
        TransportController(TaskSpec())


@pytest.mark.slow
def test_it_succeeds_in_the_default_arena() -> None:
    episodes = play(DEFAULT, 200, 64)
    assert share(episodes) >= 0.95
    clean = [e.success and not e.events.any() for e in episodes]
    assert np.mean(clean) >= 0.8
