"""One step of the radio of all copies, in one compiled call, whose parts are inlined."""

import numpy as np

from swarmdata.numerics.episode_draws import DROP_FIELD, draw_share
from swarmdata.perception.comms.links import collide, drop, pick_links, spend_bandwidth, step_bursts
from swarmdata.perception.comms.payloads import compose, write_slots
from swarmdata.runtime.kernels import kernel
from swarmdata.types import NEVER_RECEIVED, Bool, Counts, Double, Float, Int, Seeds

MAX_AGE = NEVER_RECEIVED - 1
"""Largest age that is counted."""

Memory = tuple[Float, Bool, Float, Counts, Counts]
"""The memory of a channel: messages [E, D+1, N, P] and links [E, D+1, N, N] in transit, rings over
the steps of sending; newest received message [E, N, N, P], its age [E, N, N]; state of each link
[E, N, N]."""

Constants = tuple[Int, Bool, Double, Double, Int, Double]
"""The constants of a channel: columns of the payload, which of them are positions; lower ends and
widths of the quantiser's cells, [N, P]; limits: topology, nearest senders, messages per step, time
slots, cells, bursts or not, body frame or not, largest age; chances: squared range, loss on good
and on bad links, probabilities to enter, leave and start in a burst, how much larger an episode's
loss on good and on bad links may be."""

Scratch = tuple[Bool, Double, Int, Int, Int]


@kernel
def transmit_all(
    states: Float,  # [E, S] true ones, which decide who is in range
    known: Float,  # [E, >= 8 N] the robots' measurements of themselves, columns `ROBOT` first
    seeds: Seeds,  # [E]
    times: Int,  # [E]
    said: Float,  # [E, N, P] learned messages
    active: Bool,  # [E]
    sent: Float,  # [E, N, P] written
    delivered: Bool,  # [E, N, N] written
    ages: Counts,  # [E, N, N] written
    out: Float,  # [E, N, (N-1) (P+3)] the slots, written
    memory: Memory,
    constants: Constants,
) -> None:
    """One step of the active copies."""
    messages, underway, held, newest, bad = memory
    columns, is_position, low, width, limits, chances = constants
    n, n_cells, in_body_frame, max_age = sent.shape[1], limits[4], limits[6] != 0, limits[7]
    scratch = (
        np.empty((n, n), dtype=np.bool_),
        np.empty(limits[1], dtype=np.float64),
        np.empty(limits[1], dtype=np.int64),
        np.empty((2, n), dtype=np.int64),
        np.empty(n, dtype=np.int64),
    )
    for e in range(active.shape[0]):
        if not active[e]:
            continue
        t = times[e]
        slot = t % messages.shape[1]
        compose(known, said, e, t == 0, columns, low, width, n_cells, sent)
        _choose(states, seeds[e], t, e, limits, chances, bad, scratch, underway[e, slot])
        _deliver(t, e, sent, messages, underway, held, newest, delivered, ages)
        write_slots(known, e, held, newest, columns, is_position, in_body_frame, max_age, out)


@kernel(inline="always")
def _choose(
    states: Float,
    seed: int,
    t: int,
    e: int,
    limits: Int,
    chances: Double,
    bad: Counts,
    scratch: Scratch,
    taken: Bool,
) -> None:
    """Writes which messages of step t arrive, taken [N, N]."""
    linked, distances, found, groups, counts = scratch
    share = draw_share(seed, DROP_FIELD, 0)
    in_good, in_bad = chances[1] + chances[6] * share, chances[2] + chances[7] * share
    pick_links(states, e, limits[0], chances[0], distances, found, taken)
    if limits[2] > 0 or limits[3] > 0:
        spend_bandwidth(taken, t, limits[2], linked)
    if limits[3] > 0:
        collide(seed, t, limits[3], linked, groups, counts, taken)
    if limits[5] > 0:
        step_bursts(seed, t, e, chances[3], chances[4], chances[5], bad)
    if in_good > 0.0 or in_bad > 0.0:
        drop(seed, t, e, in_good, in_bad, bad, taken)


@kernel(inline="always")
def _deliver(
    t: int,
    e: int,
    sent: Float,
    messages: Float,
    underway: Bool,
    held: Float,
    newest: Counts,
    delivered: Bool,
    ages: Counts,
) -> None:
    """Delivers the messages sent `delay` steps ago; all other received messages age."""
    n, size = sent.shape[1], sent.shape[2]
    delay = messages.shape[1] - 1
    now, then = t % (delay + 1), (t + 1) % (delay + 1)  # then: t - delay, or an empty row
    for j in range(n):
        for c in range(size):
            messages[e, now, j, c] = sent[e, j, c]
    for i in range(n):
        for j in range(n):
            arrives = underway[e, then, i, j]
            delivered[e, i, j] = arrives
            age = newest[e, i, j]
            if arrives:
                for c in range(size):
                    held[e, i, j, c] = messages[e, then, j, c]
                age = min(delay, MAX_AGE)
            elif age < MAX_AGE:
                age += 1
            newest[e, i, j] = age
            ages[e, i, j] = age
