"""Randomized bodies: an episode is that of a spec with the drawn values, alone or in a batch."""

from typing import Any

import numpy as np
import pytest

from swarmdata.envs.physics.dynamics import limits_of
from swarmdata.envs.physics.episode_bodies import episode_limits
from swarmdata.interfaces import VecEnv
from swarmdata.numerics.episode_draws import drawn_values
from swarmdata.numerics.random import derive, uniform
from swarmdata.registry.components import make_env
from swarmdata.registry.presets import preset
from swarmdata.specs.randomization import BODY_RANGES, Randomization
from swarmdata.specs.task_spec import Role, TaskSpec
from swarmdata.types import Seeds, Step

SEEDS = np.arange(40, 44, dtype=np.uint64)
RANGES: dict[str, tuple[float, float]] = {
    "max_speed": (0.4, 0.8),
    "max_acceleration": (1.0, 2.0),
    "max_turn_rate": (2.0, 4.0),
    "mass": (0.6, 2.0),
    "friction": (0.0, 1.0),
    "wheel_grip": (1.0, 6.0),
    "command_delay": (0, 3),
    "actuator_lag": (0.0, 0.3),
}
"""Of all bodies of unicycles."""


def randomized(backend: str) -> TaskSpec:
    if backend == "mujoco":
        pytest.importorskip("mujoco", reason="mujoco is not installed")
    ranges = dict(RANGES)
    if backend == "kinematic":
        del ranges["friction"]
    return preset("coop_nav-unicycle").with_updates(backend=backend, randomization=ranges)


def fixed(spec: TaskSpec, seed: int) -> TaskSpec:
    """The spec with the values that an episode draws, which has no ranges."""
    drawn = drawn_values(spec, np.array([seed], np.uint64))
    team = []
    for i, robot in enumerate(spec.robots):
        values: dict[str, Any] = {name: rows[0, i].item() for name, rows in drawn.items()}
        values["command_delay"] = int(values["command_delay"])
        team.append(Role(name=f"r{i}", count=1, robot=robot.model_copy(update=values)))
    return spec.with_updates(team=team, randomization=Randomization())


def play(env: VecEnv, seeds: Seeds, n_steps: int = 40) -> list[Step]:
    """Random commands, held for a while, that depend on the seed and the time only."""
    steps = [env.reset(seeds)]
    agents, columns = np.arange(env.spec.n_agents)[:, None], np.arange(2)
    for t in range(n_steps):
        shares = uniform(derive(seeds[:, None, None], t // 8, agents, columns))
        steps += [env.step(2 * shares - 1)]
    return steps


def test_all_fields_of_bodies_are_tested_here() -> None:
    assert set(RANGES) == set(BODY_RANGES)


@pytest.mark.parametrize("backend", ["pymunk", "mujoco", "kinematic"])
def test_an_episode_is_that_of_the_drawn_values(backend: str) -> None:
    spec = randomized(backend)
    found, n_events = play(make_env(spec, 4), SEEDS), 0
    for b, seed in enumerate(SEEDS.tolist()):
        alone = play(make_env(fixed(spec, seed)), SEEDS[b : b + 1])
        for ours, theirs in zip(found, alone, strict=True):
            np.testing.assert_array_equal(ours.states[b], theirs.states[0])
            n_events += int(ours.events[b].sum())
    assert n_events > 0 or backend == "kinematic"
    usual = play(make_env(spec.with_updates(randomization=Randomization()), 4), SEEDS)
    np.testing.assert_array_equal(usual[0].states, found[0].states)
    assert not np.array_equal(usual[-1].states, found[-1].states)


@pytest.mark.parametrize("backend", ["pymunk", "mujoco"])
def test_copies_and_threads_change_nothing(backend: str) -> None:
    spec = randomized(backend)
    one, other = play(make_env(spec, 4), SEEDS), make_env(spec, 4, n_threads=2)
    play(other, SEEDS[::-1].copy(), 5)
    for ours, theirs in zip(one, play(other, SEEDS), strict=True):
        assert all(map(np.array_equal, ours, theirs))
    other.close()


def test_limits_follow_from_all_drawn_values() -> None:
    spec = randomized("pymunk")
    limits = episode_limits(spec, SEEDS)
    for b, seed in enumerate(SEEDS.tolist()):
        np.testing.assert_allclose(limits[b], limits_of(fixed(spec, seed)), rtol=1e-15)
    mixed = TaskSpec.parse({"randomization": {"mass": [2, 2]}})
    np.testing.assert_array_equal(episode_limits(mixed, SEEDS)[..., 1], 0.75)
