"""The integers of an episode say what happened in it."""

import json
from dataclasses import replace

import numpy as np
import pytest

from swarmdata.catalogue.replays.world_columns import TURN, Columns, Group, WorldColumns
from swarmdata.datasets.reobservation import attempted_links, reobserved_episode
from swarmdata.envs.search.search_rules import SearchRules
from swarmdata.registry.appearance import MOST_MOMENTS
from swarmdata.registry.components import (
    TASKS,
    appearance_of,
    make_env,
    make_policy,
    make_task,
    reward_terms,
)
from swarmdata.registry.presets import preset
from swarmdata.rollouts.rollout import rollout
from swarmdata.specs.model_choice import with_models
from swarmdata.specs.rules import Payload
from swarmdata.specs.state_layout import N_COLUMNS, TX, X, robots_of
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.store.arrays.column_meanings import state_columns
from swarmdata.types import EVENTS, Episode


def play(spec: TaskSpec, policy: str = "straight", seed: int = 3) -> Episode:
    (episode,) = rollout(make_env(spec), make_policy(policy, spec), np.array([seed], np.uint64))
    return episode


def columns_of(found: list[tuple[Group, Columns]]) -> dict[str, tuple[Group, Columns]]:
    return {group.name: (group, values) for group, values in found}


def test_positions_and_targets_are_right_to_half_a_millimetre() -> None:
    spec = TaskSpec(horizon=30)
    episode = play(spec)
    robots = robots_of(episode.states, spec.n_agents)

    found = columns_of(WorldColumns(spec).moving(episode))

    for name, column in (("x", X), ("tx", TX)):
        group, codes = found[name]
        np.testing.assert_allclose(codes * group.unit, robots[..., column], atol=0.00051)


def test_columns_have_a_row_for_each_state() -> None:
    for name in ("coop_nav", "formation", "transport", "warehouse"):
        spec = preset(name).with_updates(horizon=5)
        episode = play(spec, "random")
        columns = WorldColumns(spec)
        for group, values in columns.moving(episode):
            assert values.shape == (len(episode) + 1, group.n_columns), group
        for group, values in columns.fixed(episode):
            assert values.shape == (1, group.n_columns), group


def test_events_are_in_the_row_of_the_state_they_led_to() -> None:
    spec = TaskSpec(horizon=60)
    episode = play(spec)

    _, codes = columns_of(WorldColumns(spec).moving(episode))["event"]

    assert episode.events.any(), "the team has to touch something"
    assert (codes[0] == 0).all()
    for name, shift, bits in (("robot_contact", 0, 1), ("obstacle_contact", 1, 1)):
        recorded = episode.events[..., EVENTS.index(name)]
        np.testing.assert_array_equal(codes[1:] >> shift & bits, recorded)
    for name, shift in (("robot_onsets", 2), ("obstacle_onsets", 5)):
        recorded = np.minimum(episode.events[..., EVENTS.index(name)], 7)
        np.testing.assert_array_equal(codes[1:] >> shift & 7, recorded)


def test_pickups_and_deliveries_are_events() -> None:
    spec = preset("warehouse")
    episode = play(spec, "scripted")

    found = columns_of(WorldColumns(spec).moving(episode))

    _, codes = found["event"]
    _, carrying = found["carrying"]
    changes = np.diff(carrying, axis=0)
    assert (changes == 1).any()
    np.testing.assert_array_equal((codes[1:] >> 8 & 1).astype(bool), changes == 1)
    np.testing.assert_array_equal((codes[1:] >> 9 & 1).astype(bool), changes == -1)


def test_headings_of_unicycles_turn_without_jumps() -> None:
    spec = preset("coop_nav-unicycle").with_updates(horizon=60)
    episode = play(spec, "random")

    group, codes = columns_of(WorldColumns(spec).moving(episode))["angle"]

    robots = robots_of(episode.states, spec.n_agents)
    turn = codes * group.unit
    np.testing.assert_allclose(np.cos(turn), robots[..., 4], atol=0.004)
    np.testing.assert_allclose(np.sin(turn), robots[..., 5], atol=0.004)
    assert np.abs(np.diff(codes, axis=0)).max() < TURN / 2


@pytest.mark.parametrize("n_agents", [4, 20])
def test_links_are_those_that_arrived_and_those_that_were_lost(n_agents: int) -> None:
    base = TaskSpec(horizon=6).model_dump()
    base["team"][0]["count"] = n_agents
    base["arena"] |= {"width": 8.0, "height": 8.0}
    plain = TaskSpec.parse(base)
    spec = with_models(plain, None, "lossy-30")
    episode = reobserved_episode(play(plain), plain, spec)

    found = columns_of(WorldColumns(spec).moving(episode))

    def links(name: str) -> np.ndarray:
        _, words = found[name]
        bits = words.reshape(len(words), n_agents, -1)[..., None] >> np.arange(15) & 1
        return bits.reshape(len(words), n_agents, -1)[..., :n_agents].astype(bool)

    attempted, others = attempted_links(episode, spec), ~np.eye(n_agents, dtype=bool)
    assert attempted is not None
    np.testing.assert_array_equal(links("heard"), episode.delivered & others)
    np.testing.assert_array_equal(links("lost"), attempted & ~episode.delivered & others)
    assert links("lost").any()


def test_goals_of_nobody_are_fixed_columns() -> None:
    spec = preset("coop_nav-unassigned").with_updates(horizon=5)
    episode = play(spec, "random")

    group, codes = columns_of(WorldColumns(spec).fixed(episode))["goal"]

    goals = episode.states[0, N_COLUMNS * spec.n_agents :]
    np.testing.assert_allclose(codes[0] * group.unit, goals, atol=0.00051)


def test_the_description_says_how_far_robots_sense() -> None:
    plain = TaskSpec()

    assert WorldColumns(plain).describe()["sensor"]["ranges"] == [None] * 4
    lidar = WorldColumns(with_models(plain, "lidar", None)).describe()["sensor"]
    assert lidar == {"kind": "lidar", "ranges": [2.0] * 4, "rays": 16}
    assert WorldColumns(plain).describe()["radio"] is None


@pytest.mark.parametrize("name", TASKS.own)
def test_every_moment_of_a_task_is_one_of_its_terms(name: str) -> None:
    spec = preset(name).with_updates(horizon=20)
    columns = WorldColumns(spec)
    look = appearance_of(spec)

    world = columns.describe()

    terms = [term.name for term in reward_terms(make_task(spec))]
    assert [moment.term for moment in look.moments if moment.term not in terms] == []
    assert world["moments"] == [list(moment) for moment in look.moments]
    assert len(look.moments) <= MOST_MOMENTS
    assert world["mark"] == look.mark
    json.dumps(world, allow_nan=False)


def test_victims_are_rescued_and_known_as_flags() -> None:
    spec = preset("search")
    episode = play(spec, "scripted")

    found = columns_of(WorldColumns(spec).moving(episode))

    _, reached = found["reached"]
    _, codes = found["event"]
    assert isinstance(spec.rules, SearchRules)
    assert reached.shape == (len(episode) + 1, spec.rules.victims)
    assert (np.diff(reached, axis=0) >= 0).all()
    assert bool(reached[-1].all()) == episode.success
    rescues = np.asarray(codes >> 9 & 1).any(axis=1)
    rescued = (np.diff(reached, axis=0) > 0).any(axis=1)
    np.testing.assert_array_equal(np.asarray(rescues)[1:], rescued)
    names = [column.name for column in state_columns(make_task(spec))]
    places = [
        [names.index(f"{robot}.known_{k}") for robot in spec.agent_names]
        for k in range(spec.rules.victims)
    ]
    seen = (episode.states[:, places] > 0).max(axis=2)
    np.testing.assert_array_equal(found["known"][1] > 0, seen)
    assert not seen[0].all()
    assert seen[-1].all()


def test_all_bodies_of_a_users_task_are_columns() -> None:
    """Two payloads, in a task that nothing here knows by its name."""

    columns = WorldColumns(preset("transport"))
    columns._look = replace(columns._look, bodies=(Payload(), Payload()))
    states = np.zeros((3, N_COLUMNS * 4 + 14), np.float32)
    states[:, N_COLUMNS * 4 + 7] = 1.5

    found = columns_of(columns._bodies(states))

    group, places = found["body"]
    assert places.shape == (3, 4)
    assert places[0, 2] * group.unit == pytest.approx(1.5)
    assert found["body_angle"][1].shape == (3, 2)
