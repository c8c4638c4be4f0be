"""The pipeline of sensors, radio and map that makes observations, of live and recorded states."""

import numpy as np

from swarmdata.interfaces import Task
from swarmdata.perception.comms.channel import Channel
from swarmdata.perception.sensing.sensor import Sensor
from swarmdata.perception.wayfinder import Wayfinder
from swarmdata.specs.features import Feature
from swarmdata.specs.sensing_models import Broadcast
from swarmdata.types import NEVER_RECEIVED, Bool, Counts, Double, Float, Int, Step


class Observer:
    """Writes the observations and messages of E copies, step after step.

    An observation holds the features of the sensor, the received messages, if any, and the ways to
    the places that these tell, if robots have a map. It is a function of the episode's seed,
    layout, states and actions up to that step, so recorded states can be reobserved.
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
        self._n_told, self._wayfinder = len(self.features), None
        if spec.observation.ways:
            self._wayfinder = Wayfinder(task, self.features, n_copies)
            self.features += self._wayfinder.features

    def observe(
        self, step: Step, actions: Float | Double | None, active: Bool, fresh: Int | None = None
    ) -> None:
        """Writes observations, sent, delivered and ages of the active copies.

        Args:
            step: the current step; its states, layouts, seeds and times are complete.
            actions: the actions that led to it, [E, N, A]; None if all active copies are fresh.
            active: copies to observe, [E].
            fresh: copies in which an episode has just begun.
        """
        if fresh is not None:
            self._sensor.forget(fresh)
        n_sensed = len(self._sensor.features)
        sensed = step.observations[..., :n_sensed]
        known = self._sensor.observe(step, active, sensed)
        if self._channel is not None:
            messages = step.observations[..., n_sensed : self._n_told]
            if fresh is not None:
                self._channel.forget(fresh)
            self._channel.transmit(step, known, actions, active, messages)
        if self._wayfinder is not None:
            self._wayfinder.observe(step, known, active)

    def allocate(self, shape: tuple[int, ...], n_agents: int) -> tuple[Float, Float, Bool, Counts]:
        """Returns initial observations, sent, delivered and ages with leading axes `shape`."""
        n = n_agents
        return (
            np.zeros((*shape, n, len(self.features)), dtype=np.float32),
            np.zeros((*shape, n, self.message_size), dtype=np.float32),
            np.zeros((*shape, n, self.n_senders), dtype=np.bool_),
            np.full((*shape, n, self.n_senders), NEVER_RECEIVED, dtype=np.uint8),
        )


def features_of(task: Task) -> tuple[Feature, ...]:
    """Returns the features of one robot's observation, including received messages."""
    return Observer(task, 1).features
