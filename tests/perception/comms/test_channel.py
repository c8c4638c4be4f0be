"""What a channel promises, whatever its model."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from swarmdata.errors import SchemaError
from swarmdata.numerics.episode_draws import drawn_values
from swarmdata.perception.comms.channel import Channel
from swarmdata.registry.components import make_env
from swarmdata.specs.communication_names import communication_model
from swarmdata.specs.sensing_models import Broadcast
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Bool, Seeds
from tests.perception.comms.trajectories import blank_step, make_spec, make_states, run

NAMES = (
    "perfect",
    "lossy-40+delayed-2",
    "bursty-50+state+bits-6",
    "nearest-2+range-1.5+delayed-1",
    "aloha-4+bandwidth-2+goal",
    "learned-3+lossy-20",
)
every_kind = pytest.mark.parametrize("name", NAMES)
draws = st.integers(0, 2**32)


def spec_of(name: str, n: int = 4, observation: str = "lidar") -> TaskSpec:
    return make_spec(n, observation, **communication_model(name).model_dump())


def seeds_from(draw: int, n_copies: int) -> Seeds:
    return np.random.default_rng(draw).integers(0, 2**64, n_copies, dtype=np.uint64)


def test_features_name_the_slots_and_their_kinds() -> None:
    features = Channel(spec_of("goal", n=3), 1).features

    vectors = ("position_x", "position_y", "heading_x", "heading_y", "target_x", "target_y")
    fields = (*vectors, "age", "mask", "sender")
    assert [f.name for f in features[9:]] == [f"message_1.{field}" for field in fields]
    assert [f.kind for f in features[:9:2]] == ["position", "direction", "position", "flag", "flag"]
    assert [f.axis for f in features[:7]] == ["x", "y"] * 3 + [""]


def test_ages_stop_at_254_and_their_feature_at_1() -> None:
    """Robot 1 hears robot 0 once, then never again: it drives out of range."""
    spec = spec_of("range-1", n=2)
    states = np.zeros((260, 1, 16), dtype=np.float32)
    states[1:, 0, 8] = 5.0
    log = run(spec, states, seeds_from(0, 1))

    assert log.ages[:, 0, 1, 0].tolist() == [min(t, 254) for t in range(260)]
    np.testing.assert_allclose(log.slots[:, 0, 1, 4], np.minimum(np.arange(260), 20) / 20)
    assert log.delivered[:, 0, 1, 0].tolist() == [True] + [False] * 259


@every_kind
@given(draw=draws)
def test_copies_that_are_not_active_are_untouched(name: str, draw: int) -> None:
    """Copy 1 pauses, and goes on as if it had not."""
    spec = spec_of(name)
    rng = np.random.default_rng(draw)
    states, seeds = make_states(rng, 6, 2, 4), seeds_from(draw, 2)
    actions = rng.uniform(-1, 1, (6, 2, 4, spec.action_size))
    expected: tuple[NDArray[Any], ...] = run(spec, states, seeds, actions)
    channel = Channel(spec, 2)
    now = blank_step(spec, channel, 2)
    now.seeds[:] = seeds
    written: list[NDArray[Any]] = [now.sent, now.delivered, now.ages, now.observations]
    for t in range(6):
        now.states[:, :32], now.times[:] = states[t], t
        before = [array.copy() for array in written]
        out = now.observations[..., 3:]
        channel.transmit(now, now.states, actions[t], np.array([True, False]), out)
        for array, old in zip(written, before, strict=True):
            np.testing.assert_array_equal(array[1], old[1])
        channel.transmit(now, now.states, actions[t], np.array([False, True]), out)
        for array, rows in zip([*written[:3], out], expected, strict=True):
            np.testing.assert_array_equal(array, rows[t])


def test_wrong_actions_are_refused() -> None:
    spec = spec_of("learned-2", n=2)
    channel = Channel(spec, 1)
    now = blank_step(spec, channel, 1)
    now.times[:] = 3
    active, out = np.array([True]), now.observations[..., 3:]

    with pytest.raises(SchemaError, match=r"\[1, 2, 2\], expected \[1, 2, 4\]"):
        channel.transmit(now, now.states, np.zeros((1, 2, 2)), active, out)
    with pytest.raises(SchemaError, match=r"None for copies \[0\]"):
        channel.transmit(now, now.states, None, active, out)


@pytest.mark.parametrize("name", ["perfect", "bursty-30"])
def test_each_episode_draws_its_losses(name: str) -> None:
    """Its messages arrive as with the drawn probability in the model."""
    channel = communication_model(name)
    assert isinstance(channel, Broadcast)
    ranges = {"drop_probability": (0.1, 0.9)}
    spec = TaskSpec().with_updates(communication=channel, randomization=ranges)
    seeds = np.arange(4, dtype=np.uint64)
    shares = drawn_values(spec, seeds)["drop_probability"][:, 0].tolist()
    found = _deliveries(spec, seeds)
    for b, share in enumerate(shares):
        known = channel.model_copy(update={"drop_probability": share})
        alone = _deliveries(TaskSpec().with_updates(communication=known), seeds[b : b + 1])
        np.testing.assert_array_equal(found[:, b], alone[:, 0])
    if name == "perfect":
        heard = found.sum(axis=(0, 2, 3)) / (len(found) * 12)
        np.testing.assert_allclose(heard, 1.0 - np.array(shares), atol=0.08)


def _deliveries(spec: TaskSpec, seeds: Seeds) -> Bool:
    """Which messages arrive in 40 steps of idle robots, [T, E, N, N]."""
    env = make_env(spec, len(seeds))
    env.reset(seeds)
    idle = np.zeros((len(seeds), spec.n_agents, 2))
    return np.array([env.step(idle).delivered for _ in range(40)])
