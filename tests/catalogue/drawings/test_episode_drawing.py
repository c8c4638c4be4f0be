"""Drawings of episodes: every task, every robot, and no more than a few kilobytes."""

from xml.etree import ElementTree

import numpy as np
import pytest

from swarmdata.catalogue.drawings.charts import rewards_drawing
from swarmdata.catalogue.drawings.episode_drawing import SIDE, episode_drawing
from swarmdata.envs.coop_nav.coop_nav import CoopNav
from swarmdata.envs.render.targets import targets_of
from swarmdata.envs.search.search_rules import SearchRules
from swarmdata.registry.appearance import Appearance
from swarmdata.registry.components import TASKS, appearance_of, make_env, make_policy
from swarmdata.registry.presets import preset
from swarmdata.rollouts.rollout import rollout
from swarmdata.specs.state_layout import N_COLUMNS, robots_of
from tests.support.own_task import thrifty_installed


@pytest.mark.parametrize("name", TASKS.own)
def test_an_episode_is_a_small_drawing(name: str) -> None:
    spec = preset(name).with_updates(horizon=40)
    policy = make_policy("random", spec)
    (episode,) = rollout(make_env(spec), policy, np.array([5], np.uint64))

    text = episode_drawing(spec, episode.layout, episode.states, "a <label>")

    tree = ElementTree.fromstring(text)
    classes = [node.get("class") for node in tree.iter()]
    assert tree.findtext("title") == "a <label>"
    assert classes.count("robot") == classes.count("way") == spec.n_agents
    assert ("payload" in classes) == (name == "transport")
    assert "obstacle" in classes
    assert len(text) < 6000
    n_shared = {"search": "victims", "pursuit": "evaders"}.get(spec.task)
    shared = 0 if n_shared is None else getattr(spec.rules, n_shared)
    assert classes.count("goal shared") == shared


def places(text: str, kind: str) -> list[tuple[float, float]]:
    """The centres of discs of a class, in units of the drawing."""
    found = (node.attrib for node in ElementTree.fromstring(text).iter("circle"))
    return [(float(each["cx"]), float(each["cy"])) for each in found if each["class"] == kind]


def test_victims_are_drawn_where_they_are() -> None:
    spec = preset("search")
    assert isinstance(spec.rules, SearchRules)
    start = make_env(spec).reset(np.array([1], np.uint64))
    state = start.states[0]
    first = N_COLUMNS * spec.n_agents
    victims = state[first : first + 2 * spec.rules.victims].reshape(-1, 2)

    text = episode_drawing(spec, start.layouts[0], start.states, "start")

    scale = SIDE / max(spec.arena.width, spec.arena.height)
    width, height = spec.arena.width * scale, spec.arena.height * scale
    expected = [(width / 2 + x * scale, height / 2 - y * scale) for x, y in victims.tolist()]
    np.testing.assert_allclose(places(text, "goal shared"), expected, atol=0.06)
    assert 'class="slot"' not in text


def test_shared_goals_of_a_team_are_drawn_once_each() -> None:
    rules = {"task": "coop_nav", "goals": "unassigned"}
    spec = preset("coop_nav").with_updates(rules=rules)
    start = make_env(spec).reset(np.array([1], np.uint64))

    text = episode_drawing(spec, start.layouts[0], start.states, "start")

    assert len(places(text, "goal shared")) == spec.n_agents
    assert not places(text, "goal")
    assert 'class="way"' not in text, "of a start"


def test_a_task_that_does_not_say_what_it_looks_like_has_rings() -> None:
    """As a user's task has that was written before there was an `Appearance`."""
    with thrifty_installed() as spec, pytest.MonkeyPatch.context() as patch:
        patch.delattr(CoopNav, "appearance")
        assert appearance_of(spec) == Appearance()
        robots = robots_of(make_env(spec).reset(np.array([1], np.uint64)).states[0], 4)
        found = targets_of(Appearance(), spec, robots.astype(float), np.empty(0))
    assert [each.robot for each in found] == [0, 1, 2, 3]
    assert [each.radius for each in found] == [robot.radius for robot in spec.robots]
    assert not any(each.is_reached for each in found)


def test_rewards_are_drawn_for_each_agent() -> None:
    rewards = np.array([[1.0, -1.0], [np.nan, 2.0]], np.float32)

    tree = ElementTree.fromstring(rewards_drawing(rewards, "rewards"))

    assert len(list(tree.iter("path"))) == 2
