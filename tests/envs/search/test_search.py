"""Search: what robots see, know and rescue, against an independent account of recorded states."""

from typing import Any

import numpy as np
import pytest

from swarmdata.envs.search.search import Search
from swarmdata.errors import SpawnError, SpecError
from swarmdata.numerics.sight import is_in_sight
from swarmdata.registry.components import make_env, make_policy
from swarmdata.registry.presets import preset
from swarmdata.rollouts.evaluate import evaluate
from swarmdata.specs.state_layout import TX, Y, robots_of
from tests.envs.worlds import check_places, seeds_of
from tests.support.made_episodes import played

SPEC = preset("search")
BASE = np.array([-3.0, -3.0])


def test_victims_keep_their_distances() -> None:
    task, n_copies = Search(SPEC), 40
    ids = np.arange(2**62, 2**62 + n_copies, dtype=np.uint64)
    step = make_env(SPEC, n_copies).reset(ids)
    c, s = task.columns, SPEC.spawn
    for state, layout in zip(step.states, step.layouts, strict=True):
        victims = state[c.victims : c.rescued].reshape(-1, 2).astype(np.float64)
        check_places(SPEC, layout, victims, s.goal_clearance, s.goal_separation, np.full(4, 0.12))
        assert not state[c.rescued : c.known].any()


def test_memory_and_targets_are_those_of_the_docstring() -> None:
    c, episode = Search(SPEC).columns, played(SPEC)
    states = episode.states.astype(np.float64)
    places = robots_of(episode.states, 4).astype(np.float64)
    victims = states[0, c.victims : c.rescued].reshape(-1, 2)
    for t in range(len(episode)):
        old, new = states[t], states[t + 1]
        known_old, known = (s[c.known : c.searched].reshape(4, -1) for s in (old, new))
        there = np.linalg.norm(places[t + 1, :, None, : Y + 1] - victims, axis=-1) <= 0.3
        rescued = (old[c.rescued : c.known] > 0) | (there.sum(0) >= 2)
        np.testing.assert_array_equal(new[c.rescued : c.known], rescued)
        for i in range(4):
            x, y = places[t + 1, i, : Y + 1]
            for k, victim in enumerate(victims):
                sees = np.hypot(*(victim - (x, y))) <= 1.2
                sees &= is_in_sight(x, y, *victim, episode.layout)
                expected = known_old[i, k] if not sees else 1 + rescued[k]
                assert known[i, k] == expected
            waiting = victims[known[i] == 1]
            target = BASE
            if len(waiting):
                target = waiting[np.linalg.norm(waiting - (x, y), axis=-1).argmin()]
            np.testing.assert_allclose(places[t + 1, i, TX:], target, atol=1e-6)
    assert episode.success
    assert episode.terminations[-1]


def test_nothing_observed_depends_on_victims_out_of_sight() -> None:
    """Without messages, moving what nobody has seen changes no observation."""
    spec = SPEC.with_updates(communication="none")
    task = Search(spec)
    env = make_env(spec, 30)
    step = env.reset(np.arange(30, dtype=np.uint64))
    names = [feature.name for feature in env.features]
    c = task.columns
    unseen = ~step.states[:, c.known : c.searched].reshape(30, 4, -1).any(1)  # [E, K]
    moved = step.states.copy()
    victims = moved[:, c.victims : c.rescued].reshape(30, -1, 2)
    victims[unseen] += np.float32(0.5)
    assert unseen.any()
    out = [np.zeros((30, 4, len(task.features)), np.float32) for _ in range(2)]
    active = np.ones(30, dtype=np.bool_)
    for states, features in zip((step.states, moved), out, strict=True):
        task.write_features(states, step.layouts, active, features)
    np.testing.assert_array_equal(out[0], out[1])
    targets = robots_of(step.states, 4)[..., TX:]
    knows = step.observations[..., names.index("knows")] > 0
    np.testing.assert_allclose(targets[~knows], np.broadcast_to(BASE, targets[~knows].shape))
    assert knows.any()


@pytest.mark.slow  # cards/references.json has the gap of `search-strict`
def test_messages_are_worth_much() -> None:
    success = {}
    for channel in ("goal", "none"):
        spec = SPEC.with_updates(communication=channel)
        policy = make_policy("scripted", spec)
        result = evaluate(policy, spec, name=channel, n_episodes=20, progress=False)
        success[channel] = result.metrics["success"].mean()
    assert success["goal"] >= 0.8  # 0.9 and more in 1,000 episodes
    assert success["none"] <= success["goal"] - 0.3


def test_metrics_are_what_their_names_say() -> None:
    episode = played(SPEC)
    task = Search(SPEC)
    values = task.episode_metrics(episode)
    assert set(values) == set(Search.metrics)
    assert values["victims_found"] == values["victims_rescued"] == 4.0
    assert 0.3 < values["floor_searched"] <= 1.0
    c, states = task.columns, episode.states[1:].astype(np.float64)
    alone = 0
    for state in states:
        for i in range(4):
            gaps = state[c.victims : c.rescued].reshape(-1, 2) - state[8 * i : 8 * i + 2]
            alone += bool(((np.hypot(*gaps.T) <= 0.3) & (state[c.rescued : c.known] == 0)).any())
    assert values["time_alone"] == pytest.approx(alone * 0.1 / 4)


@pytest.mark.parametrize(
    ("rules", "message"),
    [
        ({"helpers": 5}, "helpers is 5 in a team of 4 robots, expected at most 4"),
        ({"goal_radius": 0.2}, r"goal_radius is 0\.2 m, expected at least 0\.212 m"),
    ],
)
def test_rules_that_no_team_can_keep_are_refused(rules: dict[str, Any], message: str) -> None:
    with pytest.raises(SpecError, match=message):
        Search(SPEC.with_updates(rules={"task": "search", **rules}))


def test_more_victims_than_the_arena_holds_are_refused() -> None:
    spec = SPEC.with_updates(rules={"task": "search", "victims": 400}, spawn={"max_attempts": 3})
    with pytest.raises(SpawnError, match="and 400 victims need places too"):
        make_env(spec, 1).reset(seeds_of(1))
