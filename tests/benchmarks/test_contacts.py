"""What is measured of contacts is what the words beside it say."""

import numpy as np
import pytest

from swarmdata.envs.physics.impacts import CREEP, DEEPEST_OVERLAP
from swarmdata.registry.components import make_env
from swarmdata.registry.presets import preset
from swarmdata.rollouts.rollout import rollout
from swarmdata.specs.state_layout import robots_of
from swarmdata.types import Episode
from tests.benchmarks import bench_contacts as bench

RANDOM = preset("coop_nav")


@pytest.fixture(scope="module")
def episodes() -> list[Episode]:
    env = make_env(RANDOM, 8)
    return list(
        rollout(env, bench.team("random", RANDOM, "coop_nav"), np.arange(8, dtype=np.uint64))
    )


def test_contact_is_overlap_after_a_physics_step(episodes: list[Episode]) -> None:
    """Row 47: a state that overlaps is in a step with contact; the rest of a contact is not."""
    for episode in episodes:
        deep = bench.depths(episode, RANDOM)[1:]
        overlaps, events = deep[..., :2] > 1e-6, episode.events.astype(bool)
        assert (events[..., :2] | ~overlaps).all()
        assert (overlaps | (deep[..., :2] > -0.06) | ~events[..., :2]).all()
        began = events[..., 2:]
        assert (events[..., :2] | ~began).all(), "a contact begins with an overlap"
    contacts = sum(int(e.events[..., 1].sum()) for e in episodes)
    onsets = sum(int(e.events[..., 3].sum()) for e in episodes)
    assert 0 < onsets < contacts


def test_without_contact_a_state_tells_everything(episodes: list[Episode]) -> None:
    """Row 47: what `deviations` finds after contacts is not of its own making."""
    free, touched = [], []
    for episode in episodes:
        near = np.any(bench.depths(episode, RANDOM) > -0.01, axis=(1, 2))
        for t in np.flatnonzero(~near[:-2] & ~near[1:-1])[:20] + 1:
            reached = robots_of(episode.states[t + 1], RANDOM.n_agents)[:, :2]
            free.append(np.abs(reached - bench.again(episode, RANDOM, int(t))).max())
        touched += bench.deviations(episode, RANDOM, 50)
    assert len(free) > 20
    assert max(free) < 1e-6
    assert 10 * max(free) < max(touched) < 1e-3, "the solver's memory, which is not in the state"


def test_no_overlap_is_deep() -> None:
    today = bench.measure("coop_nav", "random", 0, 16)
    assert 0.5 * DEEPEST_OVERLAP < today.static.max() < DEEPEST_OVERLAP + CREEP
    assert 0.5 * DEEPEST_OVERLAP < today.robots.max() < DEEPEST_OVERLAP + CREEP
