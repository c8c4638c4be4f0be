"""Scripted sides of tag: together pursuers capture what each for itself does not."""

import numpy as np
import pytest

from swarmdata.registry.components import make_env, make_policy
from swarmdata.registry.presets import preset
from swarmdata.rollouts.rollout import rollout
from swarmdata.specs.state_layout import Y, robots_of
from swarmdata.types import Episode

SPEC = preset("tag")
SEEDS = np.arange(20, dtype=np.uint64)


def played(name: str) -> list[Episode]:
    return list(rollout(make_env(SPEC, 20), make_policy(name, SPEC), SEEDS))


@pytest.fixture(scope="module")
def scripted() -> list[Episode]:
    return played("scripted")


def test_surrounding_captures_what_chasing_does_not(scripted: list[Episode]) -> None:
    captured, greedy = (
        np.mean([each.success for each in episodes])
        for episodes in (scripted, played("tag-greedy"))
    )
    assert captured > 0.6
    assert greedy < 0.3


def test_the_evader_wanders_until_a_pursuer_is_near_and_then_flees(scripted: list[Episode]) -> None:
    fleeing, calm = [], []
    for episode in scripted:
        places = robots_of(episode.states, 4)[..., : Y + 1].astype(np.float64)
        gaps = np.linalg.norm(places[:, :3] - places[:, 3:], axis=-1)
        wish = np.linalg.norm(episode.actions[:, 3], axis=-1) * 1.2  # m/s
        calm += (wish[gaps[:-1].min(1) > 1.05] <= 0.15 + 1e-5).tolist()
        fleeing += wish[gaps[:-1].min(1) < 0.8][:2].tolist()
    assert np.mean(calm) > 0.9, "it hurries only to give way"
    assert np.mean(fleeing) > 0.6


def test_a_chase_differs_from_a_ring_for_the_pursuers_only() -> None:
    env = make_env(SPEC, 4)
    step = env.reset(SEEDS[:4])
    policies = [make_policy(name, SPEC) for name in ("scripted", "tag-greedy", "tag-lead-3")]
    for policy in policies:
        policy.reset(step, np.arange(4))
    for _ in range(10):
        step = env.step(np.broadcast_to([0.5, 0.0], (4, 4, 2)).copy())
    ring, greedy, lead = (policy.act(step) for policy in policies)
    assert (ring[:, 3] == greedy[:, 3]).all()
    assert (ring[:, :3] != greedy[:, :3]).any()
    assert (lead[:, :3] != greedy[:, :3]).any()
