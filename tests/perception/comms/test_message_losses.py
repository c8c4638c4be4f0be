"""How often messages get lost, against theory; tolerances are five standard errors."""

import math

import numpy as np
import pytest

from swarmdata.specs.communication_names import communication_model
from swarmdata.types import Bool
from tests.perception.comms.trajectories import make_spec, make_states, run

N, T, E = 4, 600, 16
LINKS = [(i, j) for i in range(N) for j in range(N) if i != j]
N_MESSAGES = len(LINKS) * T * E


def deliveries(name: str, n: int = N, n_steps: int = T) -> Bool:
    """Whether each message got through, [T, E, links], of robots that stay where they are."""
    spec = make_spec(n, **communication_model(name).model_dump())
    states = make_states(np.random.default_rng(0), 1, E, n).repeat(n_steps, axis=0)
    log = run(spec, states, np.arange(E, dtype=np.uint64))
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
def test_independent_losses(percent: int) -> None:
    lost = ~deliveries(f"lossy-{percent}")
    p = percent / 100
    error = math.sqrt(p * (1 - p) / N_MESSAGES)

    assert is_near(lost.mean(), p, error)
    both = lost[1:] & lost[:-1]  # one step and the next
    pair = lost[..., 0] & lost[..., 1]  # one link and another
    for joint in (both, pair):
        assert is_near(joint.mean(), p * p, math.sqrt(p * p * (1 - p * p) / joint.size * 2))


@pytest.mark.parametrize("percent", [10, 30, 60])
def test_bursts(percent: int) -> None:
    """Losses of a Gilbert channel come in geometric runs, from the first step on.

    The lag-one correlation of the chain is r = 1 - enter - leave, so the variance of a mean grows
    by (1 + r) / (1 - r).
    """
    lost = ~deliveries(f"bursty-{percent}")
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


@pytest.mark.parametrize(("n_time_slots", "n"), [(2, 3), (8, 4), (16, 7)])
def test_slotted_aloha(n_time_slots: int, n: int) -> None:
    """A message gets through if none of the other N - 1 robots chose its time slot.

    They include the receiver, which is deaf while it sends. The links of one step depend on each
    other, so the error counts steps, not messages.
    """
    heard = deliveries(f"aloha-{n_time_slots}", n)
    expected = (1 - 1 / n_time_slots) ** (n - 1)

    assert is_near(heard.mean(), expected, 0.5 / math.sqrt(T * E))


@pytest.mark.parametrize(("limit", "n"), [(1, 4), (2, 4), (3, 6), (4, 6)])
def test_links_take_turns(limit: int, n: int) -> None:
    """Over N - 1 steps each of a receiver's links gets exactly its share."""
    heard = deliveries(f"bandwidth-{limit}", n, n_steps=3 * (n - 1)).reshape(-1, E, n, n - 1)

    assert (heard.sum(-1) == limit).all()
    assert (heard[: n - 1].sum(0) == limit).all()
