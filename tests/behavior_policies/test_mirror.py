"""Mirrored actors do in a mirrored world what the actors do in the world."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from swarmdata.behavior_policies.actor import Actor, forward, load_actor, save_actor
from swarmdata.behavior_policies.mirror import mirrored
from swarmdata.errors import CheckpointError
from swarmdata.frames import find_frame
from swarmdata.presets import preset
from swarmdata.registry import make_env
from swarmdata.types import Float

ENV = make_env(preset("coop_nav"), 16)


def make_actor(folder: Path, hidden: tuple[int, ...], frame: str) -> Actor:
    draw = np.random.default_rng(3)
    turned = find_frame(ENV.features, frame)
    n_seen = ENV.observation_size + (turned.n_added if turned else 0)
    sizes = (n_seen + 4, *hidden, 2)
    layers = [(draw.normal(0, 0.3, pair), draw.normal(0, 0.1, pair[1])) for pair in pairwise(sizes)]
    path = folder / "actor.safetensors"
    save_actor(path, layers, draw.normal(size=n_seen), np.ones(n_seen), 4, turned)
    return load_actor(path.read_bytes(), 4, str(path))


def in_a_mirror(observations: Float) -> Float:
    sides = [feature.axis == "y" for feature in ENV.features]
    return np.where(sides, -observations, observations)


@pytest.mark.parametrize("hidden", [(), (8,), (16, 16)])
def test_a_mirrored_actor_acts_in_a_mirror(tmp_path: Path, hidden: tuple[int, ...]) -> None:
    actor = make_actor(tmp_path, hidden, "target")
    observations = ENV.reset(np.arange(16, dtype=np.uint64)).observations
    actions = forward(actor, observations)
    reflected = forward(mirrored(actor), in_a_mirror(observations))
    np.testing.assert_array_equal(reflected[..., 0], actions[..., 0])
    np.testing.assert_array_equal(reflected[..., 1], -actions[..., 1])
    assert not np.array_equal(forward(mirrored(actor), observations), actions)
    np.testing.assert_array_equal(forward(mirrored(mirrored(actor)), observations), actions)


def test_an_actor_in_the_worlds_frame_is_refused(tmp_path: Path) -> None:
    with pytest.raises(CheckpointError, match="with a frame"):
        mirrored(make_actor(tmp_path, (4,), "world"))
