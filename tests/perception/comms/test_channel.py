"""What a channel promises, whatever its model."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmdata.errors import SchemaError, SpecError
from swarmdata.numerics.episode_draws import drawn_values
from swarmdata.perception.comms import Channel
from swarmdata.perception.comms.payloads import quantizer
from swarmdata.registry.components import make_env
from swarmdata.specs.communication_names import communication_model
from swarmdata.specs.sensing_models import Broadcast
from swarmdata.specs.state_layout import robots_of
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import NEVER_RECEIVED, Bool, Seeds

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


def spec_of(lab: Any, name: str, n: int = 4, observation: str = "lidar") -> TaskSpec:
    return lab.make_spec(n, observation, **communication_model(name).model_dump())


def seeds_from(draw: int, n_copies: int) -> Seeds:
    return np.random.default_rng(draw).integers(0, 2**64, n_copies, dtype=np.uint64)


def test_in_a_perfect_channel_everybody_hears_everybody_now(lab: Any) -> None:
    spec = spec_of(lab, "perfect", observation="state")
    states = lab.make_states(np.random.default_rng(0), 3, 2, 4)
    log = lab.run(spec, states, seeds_from(0, 2))

    others = ~np.eye(4, dtype=bool)
    robots = robots_of(states, 4)
    np.testing.assert_array_equal(log.sent, robots[..., [0, 1, 4, 5]])
    assert (log.delivered == others).all()
    assert (log.ages[:, :, others] == 0).all()
    assert (log.ages[:, :, ~others] == NEVER_RECEIVED).all()
    slots = log.slots.reshape(3, 2, 4, 3, 7)
    expected = robots[..., 1, :2].astype(float) - robots[..., 3, :2]
    np.testing.assert_allclose(slots[..., 3, 1, :2], expected, atol=1e-6)  # robot 3 hears robot 1
    np.testing.assert_array_equal(slots[..., 3, 1, 2:4], robots[..., 1, 4:6])
    np.testing.assert_array_equal(slots[..., 4:6], np.broadcast_to([0, 1], slots[..., 4:6].shape))
    np.testing.assert_allclose(slots[0, 0, 2, :, 6], [0, 1 / 3, 1])


def test_features_name_the_slots_and_their_kinds(lab: Any) -> None:
    features = Channel(spec_of(lab, "goal", n=3), 1).features

    assert [f.name for f in features[9:]] == [
        "message_1.position_x",
        "message_1.position_y",
        "message_1.heading_x",
        "message_1.heading_y",
        "message_1.target_x",
        "message_1.target_y",
        "message_1.age",
        "message_1.mask",
        "message_1.sender",
    ]
    assert [f.kind for f in features[:9:2]] == ["position", "direction", "position", "flag", "flag"]
    assert [f.axis for f in features[:7]] == ["x", "y"] * 3 + [""]


def test_robots_with_bodies_receive_in_their_body_s_frame(lab: Any) -> None:
    """Robot 0 at (1, 1) faces +y; robot 1, two metres ahead of it, drives and faces +x."""
    states = np.zeros((1, 1, 16), dtype=np.float32)
    states[0, 0, :8] = [1, 1, 0, 0, 0, 1, 0, 0]
    states[0, 0, 8:] = [1, 3, 0.3, 0, 1, 0, 0, 0]
    in_world, in_body = (
        lab.run(spec_of(lab, "state", 2, kind), states, seeds_from(0, 1)).slots[0, 0, 0, :6]
        for kind in ("state", "lidar")
    )

    np.testing.assert_allclose(in_world, [0, 2, 0.3, 0, 1, 0])
    np.testing.assert_allclose(in_body, [2, 0, 0, -0.3, 0, -1])


@pytest.mark.parametrize("delay", [1, 3])
def test_a_delayed_message_arrives_as_it_was_sent(lab: Any, delay: int) -> None:
    spec = spec_of(lab, f"delayed-{delay}", observation="state")
    states = lab.make_states(np.random.default_rng(1), 8, 1, 4)
    log = lab.run(spec, states, seeds_from(1, 1))

    assert not log.delivered[:delay].any()
    assert not log.slots[:delay].any()
    assert (log.delivered[delay:] == ~np.eye(4, dtype=bool)).all()
    assert (log.ages[delay:, 0, 0, 1] == delay).all()
    positions = robots_of(states, 4)[:, 0, :, :2].astype(float)
    np.testing.assert_allclose(  # sender 1 then, receiver 0 now
        log.slots[delay:, 0, 0, :2], positions[:-delay, 1] - positions[delay:, 0], atol=1e-6
    )


@every_kind
@given(draw=draws)
def test_ages_follow_from_deliveries(lab: Any, name: str, draw: int) -> None:
    spec = spec_of(lab, name)
    rng = np.random.default_rng(draw)
    states = lab.make_states(rng, 12, 2, 4)
    actions = rng.uniform(-1, 1, (12, 2, 4, spec.action_size))
    log = lab.run(spec, states, seeds_from(draw, 2), actions)

    assert isinstance(spec.communication, Broadcast)
    delay = spec.communication.delay
    expected = np.full((2, 4, 4), NEVER_RECEIVED)
    for t in range(12):
        expected = np.where(expected == NEVER_RECEIVED, NEVER_RECEIVED, expected + 1)
        expected[log.delivered[t]] = delay
        np.testing.assert_array_equal(log.ages[t], expected)
    assert not log.delivered[:delay].any()
    assert not log.delivered[..., range(4), range(4)].any()


@every_kind
@given(draw=draws)
def test_a_slot_is_masked_and_zero_until_something_arrives(lab: Any, name: str, draw: int) -> None:
    spec = spec_of(lab, name)
    rng = np.random.default_rng(draw)
    states = lab.make_states(rng, 6, 2, 4)
    actions = rng.uniform(-1, 1, (6, 2, 4, spec.action_size))
    log = lab.run(spec, states, seeds_from(draw, 2), actions)

    slots = log.slots.reshape(6, 2, 4, 3, -1)
    held = np.array(
        [[log.ages[:, :, i, j] != NEVER_RECEIVED for j in range(4) if j != i] for i in range(4)]
    )
    held = held.transpose(2, 3, 0, 1)  # [T, E, receiver, slot]
    np.testing.assert_array_equal(slots[..., -2], held)
    assert not slots[~held].any()
    assert np.isfinite(slots).all()


def test_ages_stop_at_254_and_their_feature_at_1(lab: Any) -> None:
    """Robot 1 hears robot 0 once, then never again: it drives out of range."""
    spec = spec_of(lab, "range-1", n=2)
    states = np.zeros((260, 1, 16), dtype=np.float32)
    states[1:, 0, 8] = 5.0
    log = lab.run(spec, states, seeds_from(0, 1))

    assert log.ages[:, 0, 1, 0].tolist() == [min(t, 254) for t in range(260)]
    np.testing.assert_allclose(log.slots[:, 0, 1, 4], np.minimum(np.arange(260), 20) / 20)
    assert log.delivered[:, 0, 1, 0].tolist() == [True] + [False] * 259


@every_kind
@given(draw=draws)
def test_an_episode_is_the_same_in_any_batch(lab: Any, name: str, draw: int) -> None:
    spec = spec_of(lab, name)
    rng = np.random.default_rng(draw)
    states, seeds = lab.make_states(rng, 6, 5, 4), seeds_from(draw, 5)
    actions = rng.uniform(-1, 1, (6, 5, 4, spec.action_size))
    together = lab.run(spec, states, seeds, actions)

    for e in (0, 3):
        alone = lab.run(spec, states[:, [e]], seeds[[e]], actions[:, [e]])
        for one, many in zip(alone, together, strict=True):
            np.testing.assert_array_equal(one[:, 0], many[:, e])


@every_kind
@given(draw=draws, n_before=st.integers(1, 7))
def test_after_forgetting_a_channel_is_as_new(
    lab: Any, name: str, draw: int, n_before: int
) -> None:
    spec = spec_of(lab, name)
    rng = np.random.default_rng(draw)
    states, seeds = lab.make_states(rng, 6, 2, 4), seeds_from(draw, 2)
    actions = rng.uniform(-1, 1, (9, 2, 4, spec.action_size))
    used = Channel(spec, 2)
    lab.run(spec, lab.make_states(rng, n_before, 2, 4), seeds_from(draw + 1, 2), actions, used)
    used.forget(np.array([0, 1]))

    again = lab.run(spec, states, seeds, actions, used)
    for one, other in zip(again, lab.run(spec, states, seeds, actions), strict=True):
        np.testing.assert_array_equal(one, other)


@every_kind
@given(draw=draws)
def test_copies_that_are_not_active_are_untouched(lab: Any, name: str, draw: int) -> None:
    """Copy 1 pauses, and goes on as if it had not."""
    spec = spec_of(lab, name)
    rng = np.random.default_rng(draw)
    states, seeds = lab.make_states(rng, 6, 2, 4), seeds_from(draw, 2)
    actions = rng.uniform(-1, 1, (6, 2, 4, spec.action_size))
    expected = lab.run(spec, states, seeds, actions)
    channel = Channel(spec, 2)
    now = lab.blank_step(spec, channel, 2)
    now.seeds[:] = seeds
    written = (now.sent, now.delivered, now.ages, now.observations)
    for t in range(6):
        now.states[:, :32], now.times[:] = states[t], t
        before = [array.copy() for array in written]
        out = now.observations[..., 3:]
        channel.transmit(now, now.states, actions[t], np.array([True, False]), out)
        for array, old in zip(written, before, strict=True):
            np.testing.assert_array_equal(array[1], old[1])
        channel.transmit(now, now.states, actions[t], np.array([False, True]), out)
        for array, rows in zip((*written[:3], out), expected, strict=True):
            np.testing.assert_array_equal(array, rows[t])


@given(st.integers(1, 16), st.sampled_from(["goal", "state"]), draws)
def test_quantised_values_are_at_most_half_a_cell_off(
    lab: Any, bits: int, payload: str, draw: int
) -> None:
    spec = spec_of(lab, f"{payload}+bits-{bits}")
    states = lab.make_states(np.random.default_rng(draw), 2, 2, 4)
    exact = lab.run(spec_of(lab, payload), states, seeds_from(draw, 2)).sent
    sent = lab.run(spec, states, seeds_from(draw, 2)).sent

    low, width = quantizer(spec)
    inside = np.clip(exact, low, -low)
    assert (np.abs(sent - inside) <= width / 2 + 1e-6).all()
    cells = (sent - low) / width - 0.5
    np.testing.assert_allclose(cells, np.round(cells), atol=1e-6 / width.min())
    assert cells.min() > -0.5
    assert cells.max() < 2**bits - 0.5


def test_velocities_are_quantised_within_the_sender_s_speed(lab: Any) -> None:
    low, width = quantizer(spec_of(lab, "state+bits-4", n=3))

    np.testing.assert_allclose(low, [[-1.5, -2.5, -s, -s, -1, -1] for s in (0.9, 0.4, 0.4)])
    np.testing.assert_allclose(width, -2 * low / 16)


def test_learned_messages_are_the_actions_that_led_to_the_step(lab: Any) -> None:
    spec = spec_of(lab, "learned-2", n=2)
    rng = np.random.default_rng(0)
    actions = rng.uniform(-1.5, 1.5, (4, 1, 2, 4))
    log = lab.run(spec, lab.make_states(rng, 4, 1, 2), seeds_from(0, 1), actions)

    assert not log.sent[0].any()
    np.testing.assert_array_equal(log.sent[1:], actions[1:, ..., 2:].clip(-1, 1).astype(np.float32))
    np.testing.assert_array_equal(log.slots[:, 0, 0, :2], log.sent[:, 0, 1])


def test_learned_messages_are_zero_where_an_episode_begins_among_others(lab: Any) -> None:
    spec = spec_of(lab, "learned-1+bits-3", n=2)
    channel = Channel(spec, 2)
    now = lab.blank_step(spec, channel, 2)
    now.times[:] = [0, 5]
    both = np.array([True, True])
    channel.transmit(now, now.states, np.full((2, 2, 3), 0.9), both, now.observations[..., 3:])

    np.testing.assert_array_equal(now.sent[..., 0], [[0, 0], [0.875, 0.875]])


def test_wrong_actions_are_refused(lab: Any) -> None:
    spec = spec_of(lab, "learned-2", n=2)
    channel = Channel(spec, 1)
    now = lab.blank_step(spec, channel, 1)
    now.times[:] = 3
    active, out = np.array([True]), now.observations[..., 3:]

    with pytest.raises(SchemaError, match=r"\[1, 2, 2\], expected \[1, 2, 4\]"):
        channel.transmit(now, now.states, np.zeros((1, 2, 2)), active, out)
    with pytest.raises(SchemaError, match=r"None for copies \[0\]"):
        channel.transmit(now, now.states, None, active, out)


def test_a_channel_needs_robots_that_talk() -> None:
    with pytest.raises(SpecError, match="needs communication of kind 'broadcast', got 'none'"):
        Channel(TaskSpec(), 1)


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
