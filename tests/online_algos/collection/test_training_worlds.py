"""Worlds of several seeds: whose episodes they play, and what their robots see."""

import numpy as np
import pytest

from swarmdata.errors import SchemaError
from swarmdata.online_algos.collection.training_worlds import Worlds
from swarmdata.perception.frames import find_frame
from swarmdata.registry.components import make_env
from swarmdata.specs.task_spec import TaskSpec

SPEC = TaskSpec(horizon=6)


def test_training_seeds_never_meet_the_evaluation_seeds_and_never_repeat() -> None:
    worlds = Worlds(make_env(SPEC, 8), (0, 1), None)
    met = list(worlds.current_step.seeds)
    for _ in range(24):
        worlds.advance(np.zeros((2, 4, 4, 2), np.float32))
        met += list(worlds.current_step.seeds[worlds.current_step.times == 0])
    assert len(set(met)) == len(met)
    assert max(met) < 2**62


def test_training_seeds_are_those_of_published_runs() -> None:
    worlds = Worlds(make_env(SPEC, 4), (0, 7), None)
    assert worlds.current_step.seeds.tolist() == [
        2459150361376443823, 3348600503766967796, 2579403582464986583, 309689372594955804,
    ]  # fmt: skip


def test_a_copy_that_ended_begins_anew_after_its_last_step() -> None:
    worlds = Worlds(make_env(SPEC, 4), (0,), None)
    for _ in range(6):
        last = worlds.advance(np.zeros((1, 4, 4, 2), np.float32))
    assert last.truncations.all()
    assert (last.times == 6).all()
    assert (worlds.current_step.times == 0).all()


def test_actions_in_a_frame_move_robots_along_their_anchor() -> None:
    env = make_env(TaskSpec(), 4)
    worlds = Worlds(env, (0,), find_frame(env.features, "target"))
    forward = np.zeros((1, 4, 4, 2), np.float32)
    forward[..., 0] = 1.0
    before = worlds.current_step.observations[..., 4:6]
    after = worlds.advance(forward)
    speed = after.observations[..., 2:4]
    cross = before[..., 0] * speed[..., 1] - before[..., 1] * speed[..., 0]
    along = (before * speed).sum(-1)
    free = after.events.sum(-1) == 0
    np.testing.assert_allclose(cross[free], 0, atol=1e-6)
    assert (along[free] > 0).all()


def test_copies_must_divide_among_the_seeds() -> None:
    with pytest.raises(SchemaError, match="4 copies for 3 seeds"):
        Worlds(make_env(SPEC, 4), (0, 1, 2), None)
