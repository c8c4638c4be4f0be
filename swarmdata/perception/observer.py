"""What robots see and hear in a state: one pipeline for live worlds and for recorded states."""

import numpy as np

from swarmdata.interfaces import Task
from swarmdata.perception.comms import Channel
from swarmdata.perception.sensing import Sensor
from swarmdata.specs.features import Feature
from swarmdata.specs.sensing_models import Broadcast
from swarmdata.types import NEVER_RECEIVED, Bool, Counts, Double, Float, Int, Step


class Observer:
    """Fills in what was observed and heard, step after step, for E copies.

    An observation is what the sensor gives, then, with communication, the received messages. It is
    a function of the episode's seed, layout, states and actions up to that step, so states can be
    observed again, with any models, without the world.

    Args:
        task: the task; its spec has the models.
        n_copies: E.
    """

    def __init__(self, task: Task, n_copies: int) -> None:
        spec = task.spec
        self._sensor = Sensor(task, n_copies)
        has_channel = isinstance(spec.communication, Broadcast)
        self._channel = Channel(spec, n_copies) if has_channel else None
        self.features = self._sensor.features
        self.message_size, self.n_senders = 0, 0
        if self._channel is not None:
            self.features += self._channel.features
            self.message_size, self.n_senders = self._channel.message_size, spec.n_agents

    def observe(
        self, now: Step, actions: Float | Double | None, active: Bool, fresh: Int | None = None
    ) -> None:
        """Writes observations, sent, delivered and ages of the active copies.

        Args:
            now: a step whose states, layouts, seeds and times are complete.
            actions: the actions that led to it, [E, N, A]; None where all active copies are fresh.
            active: copies to observe, [E].
            fresh: copies in which an episode has just begun.
        """
        if fresh is not None:
            self._sensor.forget(fresh)
        if self._channel is None:
            self._sensor.observe(now, active, now.observations)
        else:
            cut = len(self._sensor.features)
            known = self._sensor.observe(now, active, now.observations[..., :cut])
            if fresh is not None:
                self._channel.forget(fresh)
            self._channel.transmit(now, known, actions, active, now.observations[..., cut:])

    def allocate(self, shape: tuple[int, ...], n_agents: int) -> tuple[Float, Float, Bool, Counts]:
        """Zeroed arrays (observations, sent, delivered, ages) with leading axes `shape`."""
        n = n_agents
        return (
            np.zeros((*shape, n, len(self.features)), dtype=np.float32),
            np.zeros((*shape, n, self.message_size), dtype=np.float32),
            np.zeros((*shape, n, self.n_senders), dtype=np.bool_),
            np.full((*shape, n, self.n_senders), NEVER_RECEIVED, dtype=np.uint8),
        )


def features_of(task: Task) -> tuple[Feature, ...]:
    """What each number of one robot's observation is, received messages included."""
    return Observer(task, 1).features
