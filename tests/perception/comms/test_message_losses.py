"""How often messages get lost, against theory; tolerances are five standard errors."""

import math
from typing import Any

import numpy as np
import pytest

from swarmdata.specs.communication_names import communication_model
from swarmdata.types import Bool

N, T, E = 4, 600, 16
LINKS = [(i, j) for i in range(N) for j in range(N) if i != j]
N_MESSAGES = len(LINKS) * T * E


def deliveries(lab: Any, name: str, n: int = N, n_steps: int = T) -> Bool:
    """Whether each message got through, [T, E, links], of robots that stay where they are."""
    spec = lab.make_spec(n, **communication_model(name).model_dump())
    states = lab.make_states(np.random.default_rng(0), 1, E, n).repeat(n_steps, axis=0)
    log = lab.run(spec, states, np.arange(E, dtype=np.uint64))
    return np.stack([log.delivered[..., i, j] for i in range(n) for j in range(n) if i != j], -1)


def lengths_of_runs(values: Bool) -> list[int]:
    """Lengths of the runs of True that begin and end inside each sequence, [T, sequences]."""
    lengths = []
    for sequence in values.T:
        changes = np.flatnonzero(np.diff(sequence.astype(int))) + 1
        runs = np.diff(changes)
        lengths += runs[sequence[changes[:-1]]].tolist()
    return lengths


def is_near(measured: float, expected: float, standard_error: float) -> bool:
    return abs(measured - expected) <= 5 * standard_error


@pytest.mark.parametrize("percent", [5, 30, 80])
def test_independent_losses(lab: Any, percent: int) -> None:
    lost = ~deliveries(lab, f"lossy-{percent}")
    p = percent / 100
    error = math.sqrt(p * (1 - p) / N_MESSAGES)

    assert is_near(lost.mean(), p, error)
    both = lost[1:] & lost[:-1]  # one step and the next
    pair = lost[..., 0] & lost[..., 1]  # one link and another
    for joint in (both, pair):
        assert is_near(joint.mean(), p * p, math.sqrt(p * p * (1 - p * p) / joint.size * 2))


@pytest.mark.parametrize("percent", [0, 100])
def test_nothing_or_everything_is_lost(lab: Any, percent: int) -> None:
    assert (deliveries(lab, f"lossy-{percent}") == (percent == 0)).all()


@pytest.mark.parametrize("percent", [10, 30, 60])
def test_bursts(lab: Any, percent: int) -> None:
    """Losses of a Gilbert channel come in geometric runs, from the first step on.

    The lag-one correlation of the chain is r = 1 - enter - leave, so the variance of a mean grows
    by (1 + r) / (1 - r).
    """
    lost = ~deliveries(lab, f"bursty-{percent}")
    p, leave = percent / 100, 0.25
    enter = leave * p / (1 - p)
    r = 1 - enter - leave

    error = math.sqrt(p * (1 - p) / N_MESSAGES * (1 + r) / (1 - r))
    assert is_near(lost.mean(), p, error)
    first = lost[0]
    assert is_near(first.mean(), p, math.sqrt(p * (1 - p) / first.size))
    for runs, chance in ((lost, leave), (~lost, enter)):
        lengths = np.array(lengths_of_runs(runs.reshape(T, -1)))
        deviation = math.sqrt(1 - chance) / chance
        bias = (lengths.mean() + 1) * 2 / T  # runs cut off at the ends are the long ones
        assert abs(lengths.mean() - 1 / chance) <= 5 * deviation / math.sqrt(len(lengths)) + bias
        share = (lengths == 1).mean()
        error = math.sqrt(chance * (1 - chance) / len(lengths))
        assert abs(share - chance) <= 5 * error + 2 / T


def test_losses_and_bursts_combine(lab: Any) -> None:
    lost = ~deliveries(lab, "lossy-20+bursty-30")
    p = 1 - 0.8 * 0.7

    assert is_near(lost.mean(), p, math.sqrt(p * (1 - p) / N_MESSAGES * 6))


@pytest.mark.parametrize(("n_time_slots", "n"), [(2, 3), (8, 4), (16, 7)])
def test_slotted_aloha(lab: Any, n_time_slots: int, n: int) -> None:
    """A message gets through if none of the other N - 1 robots chose its time slot.

    They include the receiver, which is deaf while it sends. The links of one step depend on each
    other, so the error counts steps, not messages.
    """
    heard = deliveries(lab, f"aloha-{n_time_slots}", n)
    expected = (1 - 1 / n_time_slots) ** (n - 1)

    assert is_near(heard.mean(), expected, 0.5 / math.sqrt(T * E))


def test_in_a_single_time_slot_nothing_is_heard(lab: Any) -> None:
    assert not deliveries(lab, "aloha-1", n_steps=5).any()


def test_what_a_receiver_does_not_decode_still_collides(lab: Any) -> None:
    """With one of three messages decoded, its chance is that of the full channel."""
    heard = deliveries(lab, "aloha-4+bandwidth-1")

    assert is_near(heard.mean(), 0.75**3 / 3, 0.5 / math.sqrt(T * E))


@pytest.mark.parametrize(("limit", "n"), [(1, 4), (2, 4), (3, 6), (4, 6)])
def test_links_take_turns(lab: Any, limit: int, n: int) -> None:
    """Over N - 1 steps each of a receiver's links gets exactly its share."""
    heard = deliveries(lab, f"bandwidth-{limit}", n, n_steps=3 * (n - 1)).reshape(-1, E, n, n - 1)

    assert (heard.sum(-1) == limit).all()
    assert (heard[: n - 1].sum(0) == limit).all()


def test_turns_follow_each_other(lab: Any) -> None:
    heard = deliveries(lab, "bandwidth-2", 6, n_steps=5).reshape(5, E, 6, 5)

    turns = [np.flatnonzero(row).tolist() for row in heard[:, 0, 3]]
    assert turns == [[0, 1], [2, 3], [0, 4], [1, 2], [3, 4]]


def test_more_bandwidth_than_links_changes_nothing(lab: Any) -> None:
    assert deliveries(lab, "bandwidth-3", n_steps=4).all()


def test_turns_are_taken_among_links_in_range_only(lab: Any) -> None:
    spec = lab.make_spec(4, **communication_model("bandwidth-1+range-1").model_dump())
    states = np.zeros((6, 1, 32), dtype=np.float32)
    states[..., 8] = 10.0  # robot 1 is far away
    log = lab.run(spec, states, np.zeros(1, dtype=np.uint64))

    assert log.delivered[:, 0, 0].sum(0).tolist() == [0, 0, 3, 3]
    assert not log.delivered[:, 0, 1].any()


@pytest.mark.parametrize(
    ("name", "heard"),
    [
        ("ring", [[1, 3], [0, 2], [1, 3], [0, 2]]),
        ("star", [[1, 2, 3], [0], [0], [0]]),
        ("nearest-1", [[1], [0], [1], [2]]),
        ("nearest-2", [[1, 2], [0, 2], [0, 1], [1, 2]]),
        ("range-2", [[1, 2], [0, 2], [0, 1], []]),
        ("nearest-2+range-1", [[1], [0, 2], [1], []]),
        ("nearest-9", [[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]]),
    ],
)
def test_topologies_of_robots_in_a_row(lab: Any, name: str, heard: list[list[int]]) -> None:
    """Robots at x = 0, 1, 2 and 4.5; of two equally near ones the first is heard."""
    spec = lab.make_spec(4, **communication_model(name).model_dump())
    states = np.zeros((1, 1, 32), dtype=np.float32)
    states[0, 0, ::8] = [0.0, 1.0, 2.0, 4.5]
    log = lab.run(spec, states, np.zeros(1, dtype=np.uint64))

    assert [np.flatnonzero(row).tolist() for row in log.delivered[0, 0]] == heard


def test_of_equally_near_senders_the_first_stay(lab: Any) -> None:
    """Robots 1 and 2 are equally far from robot 0; robot 3 is nearer than both."""
    spec = lab.make_spec(4, **communication_model("nearest-2").model_dump())
    states = np.zeros((1, 1, 32), dtype=np.float32)
    states[0, 0, ::8] = [0.0, 1.0, -1.0, 0.5]
    log = lab.run(spec, states, np.zeros(1, dtype=np.uint64))

    assert np.flatnonzero(log.delivered[0, 0, 0]).tolist() == [1, 3]
