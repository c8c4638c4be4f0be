"""The radio of a team: messages that are sent, delivered, and remembered by each robot."""

import math

import numpy as np

from swarmdata.errors import SchemaError
from swarmdata.numerics.episode_draws import DROP_FIELD, draw_share
from swarmdata.perception.comms.links import (
    NOT_DRAWN,
    TOPOLOGIES,
    collide,
    drop,
    pick_links,
    spend_bandwidth,
    step_bursts,
)
from swarmdata.perception.comms.payloads import (
    PAYLOAD_COLUMNS,
    POSITIONS,
    compose,
    message_fields,
    quantizer,
    slot_features,
    write_slots,
)
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.features import Feature
from swarmdata.specs.sensing_models import Broadcast
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import NEVER_RECEIVED, Bool, Counts, Double, Float, Int, Seeds, Step

MAX_AGE = NEVER_RECEIVED - 1  # largest age that is counted

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


class Channel:
    """Carries the messages of E copies of a team, step after step, as `Broadcast` orders them.

    A robot sends its own measured state, with the noise and delay of its sensors, and takes
    received positions relative to the same. Messages are a function of the episode's seed, states
    and actions. `Step.delivered` marks the step of arrival; `Step.ages` counts from the sending.
    """

    message_size: int
    features: tuple[Feature, ...]

    def __init__(self, spec: TaskSpec, n_copies: int) -> None:
        model, n = spec.communication, spec.n_agents
        assert isinstance(model, Broadcast)
        self._is_learned = model.payload == "learned"
        self.message_size = len(message_fields(model))
        self.features = slot_features(model, n)
        self._said = np.zeros((n_copies, n, self.message_size), dtype=np.float32)
        self._constants = _constants(spec, model)
        links = (n_copies, n, n)
        self._memory: Memory = (
            np.zeros((n_copies, model.delay + 1, n, self.message_size), dtype=np.float32),
            np.zeros((n_copies, model.delay + 1, n, n), dtype=np.bool_),
            np.zeros((*links, self.message_size), dtype=np.float32),
            np.full(links, NEVER_RECEIVED, dtype=np.uint8),
            np.full(links, NOT_DRAWN, dtype=np.uint8),
        )

    def forget(self, copies: Int) -> None:
        """Forgets all messages of these copies, in which an episode begins."""
        _, underway, _, ages, bad = self._memory
        underway[copies] = False
        ages[copies] = NEVER_RECEIVED
        bad[copies] = NOT_DRAWN

    def transmit(
        self, step: Step, known: Float, actions: Float | Double | None, active: Bool, out: Float
    ) -> None:
        """Sends, delivers and writes the messages of one step; call it once for every step.

        Args:
            step: its states (for ranges), seeds and times are read; its sent, delivered and ages
                are written.
            known: the robots' measurements of themselves, which they send and take positions
                relative to: columns `ROBOT` first, [E, >= 8 N]; the states if sensors are exact.
            actions: the actions that led to it, [E, N, A], message columns last; None if all
                active copies have just begun. Learned messages are zero when an episode begins.
            active: copies to change, [E].
            out: received messages of each robot, columns `features`, written, [E, N, F].

        Raises:
            SchemaError: messages are learned, and the actions contain none.
        """
        if self._is_learned:
            self._take_messages(actions, step.times, active)
        transmit_all(
            step.states, known, step.seeds, step.times, self._said, active, step.sent,
            step.delivered, step.ages, out, self._memory, self._constants,
        )  # fmt: skip

    def _take_messages(self, actions: Float | Double | None, times: Int, active: Bool) -> None:
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


def _constants(spec: TaskSpec, model: Broadcast) -> Constants:
    """Returns the constants of `transmit_all`, in its order."""
    columns = PAYLOAD_COLUMNS[model.payload]
    return (
        np.array(columns, dtype=np.int64),
        np.array([column in POSITIONS for column in columns], dtype=np.bool_),
        *quantizer(model, spec),
        np.array(_limits(spec, model), dtype=np.int64),
        np.array(_chances(spec, model), dtype=np.float64),
    )


def _limits(spec: TaskSpec, model: Broadcast) -> tuple[int, ...]:
    """Returns the limits of `transmit_all`, in its order."""
    return (
        TOPOLOGIES[model.topology],
        min(model.n_nearest, spec.n_agents - 1),
        model.messages_per_step or 0,
        model.slots_in_step or 0,
        0 if model.bits is None else 1 << model.bits,
        model.bursts is not None,
        spec.observation.in_body_frame,
        MAX_AGE if model.max_age is None else model.max_age,
    )


def _chances(spec: TaskSpec, model: Broadcast) -> tuple[float, ...]:
    """Returns the chances of `transmit_all`, in its order."""
    reach = math.inf if model.range is None else model.range * model.range
    in_good, most = spec.randomization.drop_probability or (model.drop_probability,) * 2
    if model.bursts is None:
        return reach, in_good, in_good, 0.0, 0.0, 0.0, most - in_good, most - in_good
    bursts = model.bursts
    both = bursts.enter + bursts.leave
    stationary = bursts.enter / both if both > 0 else 0.0  # links that never change stay good
    in_bad = 1.0 - (1.0 - in_good) * (1.0 - bursts.drop_probability)
    spread = most - in_good, (most - in_good) * (1.0 - bursts.drop_probability)
    return reach, in_good, in_bad, bursts.enter, bursts.leave, stationary, *spread


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
