"""Input statistics: seed by seed, right, and the same in any stack."""

from collections.abc import Sequence

import numpy as np
import pytest

from swarmdata.errors import SchemaError
from swarmdata.learn.networks.network_inputs import generators
from swarmdata.online_algos.collection.input_moments import measure_moments
from swarmdata.online_algos.collection.training_worlds import Worlds
from swarmdata.perception.frames import find_frame
from swarmdata.registry.components import make_env
from swarmdata.specs.task_spec import TaskSpec

SPEC = TaskSpec(horizon=12)


def worlds_of(seeds: Sequence[int]) -> Worlds:
    env = make_env(SPEC, 3 * len(seeds))
    return Worlds(env, seeds, find_frame(env.features, "target"))


def test_moments_are_those_of_the_observations() -> None:
    worlds = worlds_of([5])
    seen: list[np.ndarray] = []
    advance = worlds.advance

    def watch(actions: np.ndarray) -> object:
        assert np.abs(actions).max() <= 1
        reached = advance(actions)
        seen.append(worlds.observations(reached).reshape(-1, worlds.sizes.observation))
        return reached

    worlds.advance = watch  # type: ignore[method-assign, assignment]
    mean, std = measure_moments(worlds, generators([5], "cpu"), 15)[:2]
    rows = np.concatenate(seen).astype(np.float64)
    assert mean.shape == std.shape == (1, worlds.sizes.observation)
    assert mean.dtype == std.dtype == np.float32
    np.testing.assert_allclose(mean[0], rows.mean(0), atol=1e-6)
    expected = rows.std(0)
    moving = expected >= 1e-3
    assert moving.any()
    np.testing.assert_allclose(std[0, moving], np.maximum(expected, 0.05)[moving], rtol=1e-4)


def test_constants_keep_their_unit() -> None:
    """In the target's frame the goal has no y component."""
    worlds = worlds_of([1])
    names = [feature.name for feature in worlds.env.features]
    std = measure_moments(worlds, generators([1], "cpu"), 5).observation_std
    assert std[0, names.index("own.goal_dy")] == 1.0
    assert (std > 0).all()


def test_new_episodes_begin_afterwards() -> None:
    worlds = worlds_of([2, 7])
    before = worlds.current_step.seeds.copy()
    measure_moments(worlds, generators([2, 7], "cpu"), 4)
    assert (worlds.current_step.times == 0).all()
    assert not np.isin(worlds.current_step.seeds, before).any()


def test_a_missing_generator_is_an_error() -> None:
    with pytest.raises(SchemaError, match="got 1 generators and 5 steps, expected 2"):
        measure_moments(worlds_of([2, 7]), generators([2], "cpu"), 5)
