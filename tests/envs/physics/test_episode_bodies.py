"""Randomized bodies: an episode is that of a spec with the drawn values, alone or in a batch."""

from itertools import product

import numpy as np
import pymunk
import pytest

from swarmdata.envs.physics.dynamics import limits_of
from swarmdata.envs.physics.episode_bodies import (
    MOMENT,
    N_PAYLOAD,
    PAYLOAD_MASS,
    SLIDE_FRICTION,
    episode_limits,
    episode_payloads,
    payload_rows,
)
from swarmdata.envs.transport.transport_rules import TransportRules
from swarmdata.interfaces import VecEnv
from swarmdata.numerics.episode_draws import drawn_values
from swarmdata.numerics.random import derive, uniform
from swarmdata.registry.components import make_env
from swarmdata.registry.presets import preset
from swarmdata.specs.randomization import PAYLOAD_RANGES, RANDOM_FIELDS, Randomization
from swarmdata.specs.rules import Payload
from swarmdata.specs.task_spec import Role, TaskSpec
from swarmdata.types import Seeds, Step
from tests.envs.worlds import rules_of

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

LOADS: dict[str, tuple[float, float]] = {"payload_mass": (1.0, 9.0), "payload_friction": (0.5, 6.0)}


def ranged(preset_name: str, backend: str, ranges: dict[str, tuple[float, float]]) -> TaskSpec:
    """A preset whose bodies each episode draws."""
    if backend == "mujoco":
        pytest.importorskip("mujoco", reason="mujoco is not installed")
    ranges = {k: each for k, each in ranges.items() if (backend, k) != ("kinematic", "friction")}
    return preset(preset_name).with_updates(backend=backend, randomization=ranges)


def fixed(spec: TaskSpec, seed: int) -> TaskSpec:
    """The spec with the values that an episode draws, which has no ranges."""
    drawn, team = drawn_values(spec, np.array([seed], np.uint64)), []
    if isinstance(spec.rules, TransportRules):
        values = {field: drawn[name][0, 0].item() for name, field in PAYLOAD_RANGES.items()}
        return rules_of(spec, payload=spec.rules.payload.model_copy(update=values)).with_updates(
            randomization=Randomization()
        )
    for i, robot in enumerate(spec.robots):
        values = {name: rows[0, i].item() for name, rows in drawn.items()}
        values["command_delay"] = int(values["command_delay"])
        team.append(Role(name=f"r{i}", count=1, robot=robot.model_copy(update=values)))
    return spec.with_updates(team=team, randomization=Randomization())


def play(env: VecEnv, seeds: Seeds) -> list[Step]:
    """Random commands, held for a while, that depend on the seed and the time only."""
    steps = [env.reset(seeds)]
    agents, columns = np.arange(env.spec.n_agents)[:, None], np.arange(2)
    for t in range(40):
        shares = uniform(derive(seeds[:, None, None], t // 8, agents, columns))
        steps += [env.step(2 * shares - 1)]
    return steps


def push(env: VecEnv, seeds: Seeds) -> list[Step]:
    """All robots drive at the payload, and on when they are there."""
    steps = [env.reset(seeds)]
    for _ in range(60):
        n, states = env.spec.n_agents, steps[-1].states
        robots, payload = states[:, : 8 * n].reshape(len(seeds), n, 8), states[:, None, -7:-5]
        steps += [env.step(payload - robots[..., :2])]
    return steps


def test_all_fields_of_bodies_are_tested_here() -> None:
    assert set(RANGES) == set(RANDOM_FIELDS[:8])
    assert set(LOADS) == set(PAYLOAD_RANGES)


@pytest.mark.parametrize(
    ("name", "backend"),
    [("coop_nav-wheeled", "mujoco"),
     *product(["coop_nav-unicycle"], ["pymunk", "mujoco", "kinematic"]),
     *product(["transport"], ["pymunk", "mujoco"])],
)  # fmt: skip
def test_an_episode_is_that_of_the_drawn_values(name: str, backend: str) -> None:
    """In used worlds too, in which episodes with other bodies ended."""
    drive, ranges = (push, LOADS) if name == "transport" else (play, RANGES)
    spec = ranged(name, backend, ranges)
    used = make_env(spec, 4)
    drive(used, SEEDS + np.uint64(100))
    found, n_events = drive(used, SEEDS), 0
    for b, seed in enumerate(SEEDS.tolist()):
        alone = drive(make_env(fixed(spec, seed)), SEEDS[b : b + 1])
        for ours, theirs in zip(found, alone, strict=True):
            np.testing.assert_array_equal(ours.states[b], theirs.states[0])
            n_events += int(ours.events[b].sum())
    assert n_events > 0 or backend == "kinematic"
    usual = drive(make_env(spec.with_updates(randomization=Randomization()), 4), SEEDS)
    np.testing.assert_array_equal(usual[0].states, found[0].states)
    assert not np.array_equal(usual[-1].states[:, -7:], found[-1].states[:, -7:])
    if name == "transport":
        moved = np.abs(found[-1].states[:, -7:-5] - found[0].states[:, -7:-5]).max(1)
        assert (moved > 0.1).any()


def test_payloads_have_the_moments_of_munk() -> None:
    box = Payload(shape="box", half_length=0.37, half_width=0.21, mass=3.3)
    disc = box.model_copy(update={"shape": "circle"})
    rows = payload_rows((box, disc))
    assert rows[0, MOMENT] == pymunk.moment_for_box(3.3, (0.74, 0.42))
    assert rows[1, MOMENT] == pymunk.moment_for_circle(3.3, 0, 0.37)
    assert payload_rows(()).shape == (0, N_PAYLOAD)


def test_payloads_follow_from_the_drawn_values() -> None:
    spec = ranged("transport", "pymunk", LOADS)
    payload, drawn = Payload(), drawn_values(spec, SEEDS)
    rows = episode_payloads(spec, (payload,), SEEDS)
    np.testing.assert_array_equal(rows[:, 0, PAYLOAD_MASS], drawn["payload_mass"][:, 0])
    np.testing.assert_array_equal(rows[:, 0, SLIDE_FRICTION], drawn["payload_friction"][:, 0])
    light = spec.with_updates(randomization={"payload_mass": (1.0, 9.0)})
    rows = episode_payloads(light, (payload,), SEEDS)
    np.testing.assert_array_equal(rows[:, 0, SLIDE_FRICTION], payload.friction)


def test_limits_follow_from_all_drawn_values() -> None:
    spec = ranged("coop_nav-unicycle", "pymunk", RANGES)
    limits = episode_limits(spec, SEEDS)
    for b, seed in enumerate(SEEDS.tolist()):
        np.testing.assert_allclose(limits[b], limits_of(fixed(spec, seed)), rtol=1e-15)
    mixed = TaskSpec.parse({"randomization": {"mass": [2, 2]}})
    np.testing.assert_array_equal(episode_limits(mixed, SEEDS)[..., 1], 0.75)
