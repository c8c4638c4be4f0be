"""What is said of contacts and of states: a contact is an overlap, and none is deep."""

import numpy as np
import pytest

from swarmdata.envs.physics.backend import Contacts, Moving, Plan
from swarmdata.envs.physics.dynamics import limits_of
from swarmdata.envs.physics.episode_bodies import payload_rows
from swarmdata.envs.physics.impacts import CREEP, DEEPEST_OVERLAP
from swarmdata.envs.physics.public_backend import PublicBackend
from swarmdata.numerics.geometry import clearance
from swarmdata.registry.components import make_task
from swarmdata.registry.presets import preset
from swarmdata.specs.state_layout import N_COLUMNS, robots_of
from swarmdata.types import Double, Episode, Float
from tests.support.made_episodes import play

SPEC = preset("coop_nav")
N = SPEC.n_agents


@pytest.fixture(scope="module")
def episodes() -> list[Episode]:
    return play(SPEC, 16, "random")


def depths(episode: Episode) -> Double:
    """By how much robots overlap robots, and obstacles and walls, m [T + 1, N, 2]; -: gaps."""
    radii, half = np.array([robot.radius for robot in SPEC.robots]), np.array(SPEC.half_size)
    places = robots_of(episode.states, N)[..., :2].astype(np.float64)
    gaps = np.linalg.norm(places[:, :, None] - places[:, None], axis=-1) - radii[:, None] - radii
    gaps[:, np.eye(N, dtype=bool)] = np.inf
    free = np.array([[clearance(*place, episode.layout, half) for place in row] for row in places])
    return np.stack([-gaps.min(axis=-1), radii - free], axis=-1)


def deviation(episode: Episode, t: int) -> float:
    """How far positions after step t are from those of a new world that begins in its state, m."""
    backend = PublicBackend(Plan(SPEC, make_task(SPEC).kinds, ()), 1)
    reached: Float = episode.states[t : t + 1].copy()
    robots = reached[:, : N_COLUMNS * N].reshape(1, N, N_COLUMNS)[..., :6].astype(np.float64)
    moving = Moving(robots, np.zeros((1, 0, 7)), limits_of(SPEC), payload_rows(()))
    backend.reset(np.zeros(1, np.int64), episode.layout[None], moving)
    commands = episode.actions[t, :, :2].astype(np.float64)
    commands /= np.maximum(np.hypot(*commands.T), 1.0)[:, None]
    contacts = Contacts(
        np.zeros((1, N, N), np.bool_),
        np.zeros((1, N, len(episode.layout) + 4), np.bool_),
        np.zeros((1, N, 3)),
    )
    events = np.zeros((1, N, 4), np.uint8)
    backend.step(np.ones(1, np.bool_), commands[None], contacts, events, reached)
    there, here = robots_of(episode.states[t + 1], N), robots_of(reached[0], N)
    return float(np.abs(there[:, :2] - here[:, :2]).max())


def test_contact_is_overlap_after_a_physics_step(episodes: list[Episode]) -> None:
    """Row 47: a state that overlaps is in a step with contact; the rest of a contact is not."""
    for episode in episodes:
        deep = depths(episode)[1:]
        overlaps, events = deep > 1e-6, episode.events.astype(bool)
        assert (events[..., :2] | ~overlaps).all()
        assert (overlaps | (deep > -0.06) | ~events[..., :2]).all()
        began = events[..., 2:]
        assert (events[..., :2] | ~began).all(), "a contact begins with an overlap"
    contacts = sum(int(e.events[..., 1].sum()) for e in episodes)
    onsets = sum(int(e.events[..., 3].sum()) for e in episodes)
    assert 0 < onsets < contacts


def test_without_contact_a_state_tells_everything(episodes: list[Episode]) -> None:
    """Row 47: after contacts there is the solver's memory, which is not in the state."""
    free, touched = [], []
    for episode in episodes[:8]:
        near = np.any(depths(episode) > -0.01, axis=(1, 2))
        alone = np.flatnonzero(~near[:-2] & ~near[1:-1])[:20] + 1
        free += [deviation(episode, t) for t in alone.tolist()]
        after = np.flatnonzero((episode.events[:-1, :, :2] > 0).any(axis=(1, 2)))[:50] + 1
        touched += [deviation(episode, t) for t in after.tolist()]
    assert len(free) > 20
    assert max(free) < 1e-6
    assert 10 * max(free) < max(touched) < 1e-3


def test_no_overlap_is_deep(episodes: list[Episode]) -> None:
    """Row 47: of robots, and of a robot and an obstacle or a wall."""
    deepest = np.max([depths(episode).max(axis=(0, 1)) for episode in episodes], axis=0)
    assert (deepest > 0.5 * DEEPEST_OVERLAP).all()
    assert (deepest < DEEPEST_OVERLAP + CREEP).all()
