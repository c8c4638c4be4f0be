"""Drawings of episodes: every task, every robot, and no more than a few kilobytes."""

from xml.etree import ElementTree

import numpy as np
import pytest

from swarmdata.catalogue.drawings.episode_drawing import episode_drawing
from swarmdata.catalogue.drawings.rewards_drawing import rewards_drawing
from swarmdata.registry.components import make_env, make_policy
from swarmdata.registry.presets import preset
from swarmdata.rollouts.rollout import rollout


@pytest.mark.parametrize("name", ["coop_nav", "formation", "transport", "warehouse"])
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


def test_a_start_has_no_ways() -> None:
    spec = preset("coop_nav")
    start = make_env(spec).reset(np.array([1], np.uint64))

    text = episode_drawing(spec, start.layouts[0], start.states, "start")

    assert 'class="way"' not in text
    assert text.count('class="robot"') == 4


def test_rewards_are_drawn_for_each_agent() -> None:
    rewards = np.array([[1.0, -1.0], [np.nan, 2.0]], np.float32)

    tree = ElementTree.fromstring(rewards_drawing(rewards, "rewards"))

    assert len(list(tree.iter("path"))) == 2
