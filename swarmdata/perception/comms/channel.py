"""The radio of a team: messages that are sent, delivered, and remembered by each robot."""

import math

import numpy as np

from swarmdata.errors import SchemaError
from swarmdata.perception.comms.links import NOT_DRAWN, TOPOLOGIES
from swarmdata.perception.comms.payloads import (
    PAYLOAD_COLUMNS,
    POSITIONS,
    message_fields,
    quantizer,
    slot_features,
)
from swarmdata.perception.comms.transmission import MAX_AGE, Constants, Memory, transmit_all
from swarmdata.specs.features import Feature
from swarmdata.specs.sensing_models import Broadcast
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import NEVER_RECEIVED, Bool, Double, Float, Int, Step


class Channel:
    """Carries the messages of E copies of a team, step after step.

    In every step each robot broadcasts one message. These stages follow each other:

    1. Quantise: each value is replaced by the middle of one of 2**bits equal cells, and clipped.
    2. Links: topology and range (distance between centres when the message is sent) say which
       senders each receiver can hear.
    3. Bandwidth: a receiver decodes at most `messages_per_step` of them, in turn. The others still
       collide.
    4. Collisions: with `slots_in_step`, messages that reach a receiver in the same time slot
       destroy each other, and a robot that sends is deaf (slotted ALOHA).
    5. Drops: each link loses the message by chance, on its own or in Gilbert-Elliott bursts.
    6. Delay: the messages that remain arrive unchanged `delay` steps later.

    A robot sends its own measured state, with the noise and delay of its sensors, and takes
    received positions relative to the same. It keeps the newest message of every other robot, and
    reads it until it is older than `max_age`; only the robot that it is for reads an errand. The
    messages are a function of the episode's seed, states and actions: the same alone and in any
    batch. `Step.delivered` marks the step of arrival; `Step.ages` counts from the step of sending.

    Args:
        spec: its communication is a `Broadcast`.
        n_copies: E.
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
