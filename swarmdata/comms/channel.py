"""The radio of a team: what every robot sends, who hears it when, and what each robot remembers."""

import math

import numpy as np
from numba import njit

from swarmdata.comms.links import (
    NOT_DRAWN,
    TOPOLOGIES,
    collide,
    drop,
    pick_links,
    spend_bandwidth,
    step_bursts,
)
from swarmdata.comms.payloads import (
    COLUMNS,
    broadcast_of,
    compose,
    message_fields,
    quantizer,
    slot_features,
    write_slots,
)
from swarmdata.errors import SchemaError
from swarmdata.features import Feature
from swarmdata.spec import Broadcast, TaskSpec
from swarmdata.states import TX, TY, X, Y
from swarmdata.types import NEVER, Bool, Counts, Double, Float, Int, Seeds, Step

OLDEST = NEVER - 1
"""Ages stop here."""

Memory = tuple[Float, Bool, Float, Counts, Counts]
Constants = tuple[Int, Bool, Double, Double, Int, Double]
Scratch = tuple[Bool, Double, Int, Int, Int]


class Channel:
    """Carries the messages of E copies of a team, step after step.

    In every step each robot broadcasts one message. What happens to it, in this order:

    1. Quantise: each value is replaced by the middle of one of 2**bits equal cells, and clipped.
    2. Links: topology and range (distance between centres when the message is sent) say which
       senders each receiver can hear.
    3. Bandwidth: a receiver decodes at most `messages_per_step` of them, in turn. What it does not
       decode is still on air.
    4. Collisions: with `slots_in_step`, messages that reach a receiver in the same time slot
       destroy each other, and a robot that sends is deaf (slotted ALOHA).
    5. Drops: each link loses the message by chance, on its own or in Gilbert-Elliott bursts.
    6. Delay: what got through arrives, as it was sent, `delay` steps later.

    A robot keeps the newest message of every other robot. What it receives is a function of the
    episode's seed, states and actions: the same alone and in any batch. Whatever `Step.delivered`
    says arrived, arrived in that step; `Step.ages` counts from the step of sending.

    Args:
        spec: its communication must be a `Broadcast`.
        n_copies: E.

    Raises:
        SpecError: the spec's robots do not talk.
    """

    message_size: int
    features: tuple[Feature, ...]

    def __init__(self, spec: TaskSpec, n_copies: int) -> None:
        model = broadcast_of(spec)
        n = spec.n_agents
        self._is_learned = model.payload == "learned"
        self.message_size = len(message_fields(model))
        self.features = slot_features(model, n)
        self._said = np.zeros((n_copies, n, self.message_size), dtype=np.float32)
        self._constants = _constants(spec)
        links = (n_copies, n, n)
        self._memory: Memory = (
            np.zeros((n_copies, model.delay + 1, n, self.message_size), dtype=np.float32),
            np.zeros((n_copies, model.delay + 1, n, n), dtype=np.bool_),
            np.zeros((*links, self.message_size), dtype=np.float32),
            np.full(links, NEVER, dtype=np.uint8),
            np.full(links, NOT_DRAWN, dtype=np.uint8),
        )

    def forget(self, copies: Int) -> None:
        """Forgets all messages of the copies listed: an episode begins there."""
        _, underway, _, ages, bad = self._memory
        underway[copies] = False
        ages[copies] = NEVER
        bad[copies] = NOT_DRAWN

    def transmit(self, now: Step, actions: Float | Double | None, active: Bool, out: Float) -> None:
        """Sends, delivers and shows the messages of one step.

        To be called once for every step of an episode, from its beginning on.

        Args:
            now: its states, seeds and times are read; its sent, delivered and ages are written.
            actions: the actions that led to it, [E, N, A], message columns last; None where all
                active copies have just begun. Learned messages are zero when an episode begins.
            active: copies to do it for; nothing of the others is touched, [E].
            out: what each robot has received, columns `features`, written, [E, N, F].

        Raises:
            SchemaError: learned messages are to be sent, and the actions have none.
        """
        if self._is_learned:
            self._listen_to(actions, now.times, active)
        _transmit(
            now.states,
            now.seeds,
            now.times,
            self._said,
            active,
            now.sent,
            now.delivered,
            now.ages,
            out,
            self._memory,
            self._constants,
        )

    def _listen_to(self, actions: Float | Double | None, times: Int, active: Bool) -> None:
        """Takes the message columns of the actions, rounded to float32 as they are recorded."""
        if actions is None:
            if times[active].any():
                raise SchemaError(
                    "learned messages are part of the actions, got actions None for copies "
                    f"{np.flatnonzero(active & (times > 0)).tolist()} in the middle of an "
                    "episode. Pass the actions that led to the step."
                )
            return
        n_copies, n, size = self._said.shape
        if actions.shape != (n_copies, n, 2 + size):
            raise SchemaError(
                f"actions are {list(actions.shape)}, expected {[n_copies, n, 2 + size]}: two "
                f"columns for driving, then {size} of the message that the spec makes robots learn."
            )
        self._said[...] = actions[..., 2:]


def _constants(spec: TaskSpec) -> Constants:
    """Payload's columns, which are positions; cells' lower ends, widths; limits; chances."""
    model = broadcast_of(spec)
    columns = COLUMNS[model.payload]
    is_position = [column in {X, Y, TX, TY} for column in columns]
    low, width = quantizer(spec)
    return (
        np.array(columns, dtype=np.int64),
        np.array(is_position, dtype=np.bool_),
        low,
        width,
        np.array(_limits(spec, model), dtype=np.int64),
        np.array(_chances(model), dtype=np.float64),
    )


def _limits(spec: TaskSpec, model: Broadcast) -> tuple[int, ...]:
    """Topology, nearest senders, messages per step, time slots, cells; bursts? body frame?"""
    return (
        TOPOLOGIES[model.topology],
        min(model.n_nearest, spec.n_agents - 1),
        model.messages_per_step or 0,
        model.slots_in_step or 0,
        0 if model.bits is None else 1 << model.bits,
        model.bursts is not None,
        spec.observation.kind != "state",
    )


def _chances(model: Broadcast) -> tuple[float, ...]:
    """Squared range; loss on good and bad links; entering, leaving, starting in a burst."""
    reach = math.inf if model.range is None else model.range * model.range
    in_good = model.drop_probability
    if model.bursts is None:
        return reach, in_good, in_good, 0.0, 0.0, 0.0
    bursts = model.bursts
    both = bursts.enter + bursts.leave
    stationary = bursts.enter / both if both > 0 else 0.0  # links that never change stay good
    in_bad = 1.0 - (1.0 - in_good) * (1.0 - bursts.drop_probability)
    return reach, in_good, in_bad, bursts.enter, bursts.leave, stationary


@njit(nogil=True, cache=True)
def _transmit(
    states: Float,
    seeds: Seeds,
    times: Int,
    said: Float,
    active: Bool,
    sent: Float,
    delivered: Bool,
    ages: Counts,
    out: Float,
    memory: Memory,
    constants: Constants,
) -> None:
    """One step of the active copies.

    Args:
        states: [E, S].
        seeds: [E].
        times: [E].
        said: learned messages, [E, N, P].
        active: [E].
        sent: written, [E, N, P].
        delivered: written, [E, N, N].
        ages: written, [E, N, N].
        out: the slots, written, [E, N, (N-1) (P+3)].
        memory: messages [E, D+1, N, P] and links [E, D+1, N, N] that are under way, rings over the
            steps of sending; newest message held [E, N, N, P], its age [E, N, N]; state of each
            link [E, N, N].
        constants: what `_constants` returns.
    """
    messages, underway, held, newest, bad = memory
    columns, is_position, low, width, limits, chances = constants
    n, n_cells, in_body_frame = sent.shape[1], limits[4], limits[6] != 0
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
        compose(states, said, e, t == 0, columns, low, width, n_cells, sent)
        _choose(states, seeds[e], t, e, limits, chances, bad, scratch, underway[e, slot])
        _deliver(t, e, sent, messages, underway, held, newest, delivered, ages)
        write_slots(states, e, held, newest, columns, is_position, in_body_frame, out)


@njit(nogil=True, cache=True)
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
    """Writes which messages of step t get through, taken [N, N]."""
    linked, distances, found, groups, counts = scratch
    in_good, in_bad = chances[1], chances[2]
    pick_links(states, e, limits[0], chances[0], distances, found, taken)
    if limits[2] > 0 or limits[3] > 0:
        spend_bandwidth(taken, t, limits[2], linked)
    if limits[3] > 0:
        collide(seed, t, limits[3], linked, groups, counts, taken)
    if limits[5] > 0:
        step_bursts(seed, t, e, chances[3], chances[4], chances[5], bad)
    if in_good > 0.0 or in_bad > 0.0:
        drop(seed, t, e, in_good, in_bad, bad, taken)


@njit(nogil=True, cache=True)
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
    """Hands over what was sent `delay` steps ago; what is held otherwise grows older.

    Values are copied one by one: compiled slice assignments are several times slower.
    """
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
                age = min(delay, OLDEST)
            elif age < OLDEST:
                age += 1
            newest[e, i, j] = age
            ages[e, i, j] = age
