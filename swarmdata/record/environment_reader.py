"""EnvironmentReader: the state, events and layout of an environment after a reset or step."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from swarmdata.errors import SchemaError
from swarmdata.record.agent_reader import AgentReader
from swarmdata.record.episode_buffer import StateRow
from swarmdata.record.recording_description import StateSource
from swarmdata.specs.origins import Spec
from swarmdata.specs.spaces import to_float32
from swarmdata.types import Bool, Counts, Float, FloatOrByte, no_messages


@dataclass(frozen=True, slots=True, eq=False)
class EnvironmentReader:
    """Reads an environment after a reset or step.

    Attributes:
        env: a `ParallelEnv`; a `ParallelWorld` if it is a task of this library.
        reader: reads values by agent.
        spec: the recording's spec.
        source: where states come from.
        has_masks: whether the recording has action masks.
    """

    env: Any
    reader: AgentReader
    spec: Spec
    source: StateSource
    has_masks: bool

    @property
    def is_own_task(self) -> bool:
        """Whether this is a task of this library, with events, messages and layouts."""
        return self.spec.world is not None

    def state(
        self, observations: Mapping[Any, Any], infos: Mapping[Any, Any], alive: Bool, seen: Bool
    ) -> StateRow:
        """The state that was reached.

        Args:
            observations: by agent.
            infos: by agent.
            alive: agents that act next, [N].
            seen: agents that act next or acted in the step before, [N].

        Raises:
            SchemaError: a value does not fit its space, or is not finite.
        """
        rows, concatenated = self.reader.observations(observations, seen)
        if self.is_own_task:
            step = self.env.current_step
            names = ("sent", "delivered", "ages")
            messages = {name: getattr(step, name)[0].copy() for name in names}
        else:
            messages = no_messages(len(alive))
        return StateRow(
            observations=rows,
            state=self._state(concatenated),
            alive=alive,
            masks=self._masks(observations, infos, alive),
            **messages,
        )

    def events(self) -> Counts:
        """Safety events of the last step, [N, 4], or [N, 0] for a foreign environment."""
        if self.is_own_task:
            return np.array(self.env.current_step.events[0])
        return np.zeros((len(self.reader.names), 0), dtype=np.uint8)

    def reward_terms(self) -> Float | None:
        """Unweighted terms of the last step's rewards, [N, R]; None for a foreign environment."""
        return np.array(self.env.current_step.reward_terms[0]) if self.is_own_task else None

    def layout(self) -> Float:
        """Obstacles of the episode, [M, 8]."""
        if self.is_own_task:
            return np.array(self.env.current_step.layouts[0])
        return np.zeros((0, 8), dtype=np.float32)

    def _state(self, concatenated: FloatOrByte) -> FloatOrByte:
        """The state, [S], given the concatenated observations; an image of bytes stays uint8."""
        if self.source == "observations":
            return concatenated
        try:
            state = np.asarray(self.env.state())
        except Exception as error:  # a foreign environment may raise anything
            raise SchemaError(
                f"state() of {self.env} failed after it had worked before: {error!r}. Some "
                "environments have no state at the end of an episode; record all observations "
                "instead with state='observations'."
            ) from error
        row: FloatOrByte = state.reshape(-1)
        if state.dtype != np.uint8:
            row = to_float32(row, "state()")
        if self.spec.state_size not in (None, len(row)):
            raise SchemaError(
                f"state() returned {len(row)} numbers, expected {self.spec.state_size} as after "
                "the first reset"
            )
        return row

    def _masks(
        self, observations: Mapping[Any, Any], infos: Mapping[Any, Any], alive: Bool
    ) -> Bool | None:
        if self.has_masks:
            return self.reader.masks(observations, infos, alive)
        if self.reader.has_masks(observations, infos):
            raise SchemaError(
                "an action mask appeared after the first reset had none, so earlier states have no "
                "masks. Let the environment give masks from its first reset on."
            )
        return None
