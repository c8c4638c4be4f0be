"""Selection of the messages of one step: topology, range, bandwidth, collisions, drops.

A link is a pair (receiver, sender); its random numbers depend on no other link.
"""

import math

from swarmdata.numerics.random import STREAMS
from swarmdata.numerics.random_kernels import absorb, to_uniform
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.state_layout import N_COLUMNS, X, Y
from swarmdata.types import Bool, Counts, Double, Float, Int

FULL, NEAREST, RING, STAR = range(4)  # codes of `TOPOLOGIES`

TOPOLOGIES = {"full": FULL, "nearest": NEAREST, "ring": RING, "star": STAR}

GOOD, BAD, NOT_DRAWN = range(3)
"""States of a link with bursts; the last one before the first step of an episode."""

DROP, BURST, TIME_SLOT = range(3)  # purposes of random numbers

_CHANNEL_STREAM = STREAMS["channel"]


@kernel(inline="always")
def purpose_bits(seed: int, t: int, purpose: int) -> int:
    """The counter of one purpose in one step; it then absorbs the sender and the receiver."""
    return absorb(absorb(absorb(seed, _CHANNEL_STREAM), t), purpose)


@kernel(inline="always")
def squared_distance(states: Float, e: int, i: int, j: int) -> float:
    """Squared distance between the centres of robots i and j of copy e, m^2."""
    dx = float(states[e, N_COLUMNS * j + X]) - float(states[e, N_COLUMNS * i + X])
    dy = float(states[e, N_COLUMNS * j + Y]) - float(states[e, N_COLUMNS * i + Y])
    return dx * dx + dy * dy


@kernel(inline="always")
def _in_topology(topology: int, i: int, j: int, n: int) -> bool:
    """Whether robots i and j are linked, in a topology that does not depend on positions."""
    if topology == RING:
        return (i + 1) % n == j or (j + 1) % n == i
    return topology == FULL or i == 0 or j == 0


@kernel(inline="always")
def pick_links(
    states: Float,  # [E, S]
    e: int,  # the copy
    topology: int,  # one of the codes above
    reach: float,  # square of the range, square metres; infinite for no limit
    distances: Double,  # [K] scratch for the nearest senders
    found: Int,  # scratch, [K]; K is the number of senders in topology "nearest"
    linked: Bool,  # written
) -> None:
    """Writes which senders each receiver of copy e can receive from, linked [N, N]."""
    n = linked.shape[0]
    for i in range(n):
        if topology == NEAREST:
            _pick_nearest(states, e, i, reach, distances, found, linked)
            continue
        for j in range(n):
            is_linked = j != i and _in_topology(topology, i, j, n)
            if is_linked and reach < math.inf:
                is_linked = squared_distance(states, e, i, j) <= reach
            linked[i, j] = is_linked


@kernel
def _pick_nearest(
    states: Float, e: int, i: int, reach: float, distances: Double, found: Int, linked: Bool
) -> None:
    """Links robot i to the nearest senders within reach; ties go to the lower number."""
    n_found = 0
    for j in range(linked.shape[0]):
        linked[i, j] = False
        d = squared_distance(states, e, i, j)
        if j == i or d > reach:
            continue
        if n_found == found.shape[0]:
            if d >= distances[n_found - 1]:
                continue
            n_found -= 1
        slot = n_found
        while slot > 0 and distances[slot - 1] > d:
            distances[slot], found[slot] = distances[slot - 1], found[slot - 1]
            slot -= 1
        distances[slot], found[slot] = d, j
        n_found += 1
    for slot in range(n_found):
        linked[i, found[slot]] = True


@kernel
def spend_bandwidth(taken: Bool, t: int, limit: int, linked: Bool) -> None:
    """Removes from `taken`, [N, N], the messages that a receiver does not decode; `limit` remain.

    The links of a receiver, in sender order, take turns: in step t those from number t * limit on,
    cyclically. A limit of 0 is none. All links are copied to `linked` first, [N, N].
    """
    n = linked.shape[0]
    for i in range(n):
        n_linked = 0
        for j in range(n):
            linked[i, j] = taken[i, j]
            n_linked += linked[i, j]
        if limit == 0 or n_linked <= limit:
            continue
        start, rank = t * limit % n_linked, 0
        for j in range(n):
            if linked[i, j]:
                taken[i, j] = (rank - start) % n_linked < limit
                rank += 1


@kernel
def collide(
    seed: int,  # of the episode
    t: int,  # the step
    n_time_slots: int,  # at least 1; with 1, no message ever arrives
    linked: Bool,  # [N, N]
    groups: Int,  # [2, N] scratch
    counts: Int,  # [N] scratch
    taken: Bool,  # [N, N] changed
) -> None:
    """Removes from `taken` the messages that collide in slotted ALOHA.

    Every robot sends in one of `n_time_slots` time slots of the step, drawn evenly and anew each
    step (Abramson, "The ALOHA system", 1970; slots: Roberts, "ALOHA packet system with and without
    slots and capture", 1975; no capture here). A receiver loses all messages of a time slot in
    which two or more linked robots send, decoded or not, and is deaf while it sends itself.
    """
    n = linked.shape[0]
    base = purpose_bits(seed, t, TIME_SLOT)
    for j in range(n):  # groups[1]: the first robot that sends in the same time slot
        groups[0, j] = int(to_uniform(absorb(base, j)) * n_time_slots)
        groups[1, j] = j
        for k in range(j):
            if groups[0, k] == groups[0, j]:
                groups[1, j] = k
                break
    for i in range(n):
        counts[:] = 0
        counts[groups[1, i]] = 1
        for j in range(n):
            if linked[i, j]:
                counts[groups[1, j]] += 1
        for j in range(n):
            if taken[i, j] and counts[groups[1, j]] > 1:
                taken[i, j] = False


@kernel
def step_bursts(
    seed: int,  # of the episode
    t: int,  # the step
    e: int,  # the copy
    enter: float,  # probability that a good link turns bad
    leave: float,  # probability that a bad link turns good
    stationary: float,  # probability that a link is bad when the episode begins
    bad: Counts,  # [E, N, N] state of each link, changed
) -> None:
    """Takes one step of the Gilbert-Elliott chain of every link of copy e, used or not.

    Two states after Gilbert, "Capacity of a burst-noise channel" (1960), section II, and Elliott,
    "Estimates of error rates for codes on burst-noise channels" (1963).
    """
    base = purpose_bits(seed, t, BURST)
    n = bad.shape[1]
    for j in range(n):
        from_sender = absorb(base, j)
        for i in range(n):
            if i == j:
                continue
            luck = to_uniform(absorb(from_sender, i))
            if bad[e, i, j] == NOT_DRAWN:
                bad[e, i, j] = BAD if luck < stationary else GOOD
            elif bad[e, i, j] == BAD:
                bad[e, i, j] = GOOD if luck < leave else BAD
            else:
                bad[e, i, j] = BAD if luck < enter else GOOD


@kernel
def drop(
    seed: int,  # of the episode
    t: int,  # the step
    e: int,  # the copy
    in_good: float,  # probability that a message is lost on a good link
    in_bad: float,  # probability that a message is lost on a bad link
    bad: Counts,  # [E, N, N] state of each link
    taken: Bool,  # [N, N] changed
) -> None:
    """Removes from `taken` the messages that are lost by chance."""
    base = purpose_bits(seed, t, DROP)
    n = taken.shape[0]
    for j in range(n):
        from_sender = absorb(base, j)
        for i in range(n):
            if taken[i, j]:
                chance = in_bad if bad[e, i, j] == BAD else in_good
                taken[i, j] = to_uniform(absorb(from_sender, i)) >= chance
