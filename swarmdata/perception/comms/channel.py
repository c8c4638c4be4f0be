"""The radio of a team: what every robot sends, who hears it when, and what each robot remembers."""

import math

import numpy as np

from swarmdata.errors import SchemaError
from swarmdata.perception.comms.links import NOT_DRAWN, TOPOLOGIES
from swarmdata.perception.comms.payloads import (
    PAYLOAD_COLUMNS,
    broadcast_of,
    message_fields,
    quantizer,
    slot_features,
)
from swarmdata.perception.comms.transmission import Constants, Memory, transmit_all
from swarmdata.specs.features import Feature
from swarmdata.specs.sensing_models import Broadcast
from swarmdata.specs.state_layout import TX, TY, X, Y
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import NEVER, Bool, Double, Float, Int, Step


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

    A robot sends what its own sensors tell it of itself, with their noise and delay, and takes what
    it hears relative to the same. It keeps the newest message of every other robot. What it
    receives is a function of the episode's seed, states and actions: the same alone and in any
    batch. Whatever `Step.delivered` says arrived, arrived in that step; `Step.ages` counts from the
    step of sending.

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

    def transmit(
        self, now: Step, known: Float, actions: Float | Double | None, active: Bool, out: Float
    ) -> None:
        """Sends, delivers and shows the messages of one step.

        To be called once for every step of an episode, from its beginning on.

        Args:
            now: its states (for ranges), seeds and times are read; its sent, delivered and ages
                are written.
            known: what each robot knows of itself in this step, and so what it sends and what it
                compares with what it hears: columns `ROBOT` first, [E, >= 8 N]; the states
                themselves where sensors are exact.
            actions: the actions that led to it, [E, N, A], message columns last; None where all
                active copies have just begun. Learned messages are zero when an episode begins.
            active: copies to do it for; nothing of the others is touched, [E].
            out: what each robot has received, columns `features`, written, [E, N, F].

        Raises:
            SchemaError: learned messages are to be sent, and the actions have none.
        """
        if self._is_learned:
            self._listen_to(actions, now.times, active)
        transmit_all(
            now.states,
            known,
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
    columns = PAYLOAD_COLUMNS[model.payload]
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
