"""Rows, the arrays that one environment gives at a reset and at each step."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from swarmdata.errors import SchemaError
from swarmdata.record.episode_buffer import StateRow
from swarmdata.record.recording_description import StateSource
from swarmdata.record.row_reader import Reader
from swarmdata.specs.origins import Spec
from swarmdata.types import Bool, Counts, Float, no_messages


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """Reads an environment after each of its resets and steps.

    Attributes:
        env: a `ParallelEnv`; of a task of this library, a `ParallelWorld`.
        reader: of its agents.
        spec: that the recording has.
        source: of states.
        has_masks: whether there are action masks.
    """

    env: Any
    reader: Reader
    spec: Spec
    source: StateSource
    has_masks: bool

    @property
    def is_ours(self) -> bool:
        """Whether there are events, messages and layouts."""
        return self.spec.world is not None

    def state(
        self, observations: Mapping[Any, Any], infos: Mapping[Any, Any], alive: Bool, seen: Bool
    ) -> StateRow:
        """What was reached.

        Args:
            observations: by agent.
            infos: by agent.
            alive: who acts next, [N].
            seen: these, and who acted in the step before, [N].

        Raises:
            SchemaError: something does not fit the spaces, or is not finite.
        """
        rows, plain = self.reader.observations(observations, seen)
        if self.is_ours:
            step = self.env.current_step
            names = ("sent", "delivered", "ages")
            messages = {name: getattr(step, name)[0].copy() for name in names}
        else:
            messages = no_messages(len(alive))
        return StateRow(
            observations=rows,
            state=self._state(plain),
            alive=alive,
            masks=self._masks(observations, infos, alive),
            **messages,
        )

    def events(self) -> Counts:
        """Safety events of the last step, [N, 4], or [N, 0] where there are none."""
        if self.is_ours:
            return np.array(self.env.current_step.events[0])
        return np.zeros((len(self.reader.names), 0), dtype=np.uint8)

    def layout(self) -> Float:
        """Obstacles of the episode, [M, 8]."""
        if self.is_ours:
            return np.array(self.env.current_step.layouts[0])
        return np.zeros((0, 8), dtype=np.float32)

    def _state(self, plain: Float) -> Float:
        """The state, [S], of observations without padding in one."""
        if self.source == "observations":
            return plain
        try:
            state = np.asarray(self.env.state())
        except Exception as error:  # of the environment, which may raise anything
            raise SchemaError(
                f"state() of {self.env} failed after it had worked before: {error!r}. Some "
                "environments have no state of their end; record all observations in its place "
                "with state='observations'."
            ) from error
        if state.dtype.kind not in "biuf" or not np.isfinite(state).all():
            raise SchemaError(f"state() gave {state!r}, expected finite numbers")
        row: Float = state.reshape(-1).astype(np.float32)
        if self.spec.state_size not in (None, len(row)):
            raise SchemaError(
                f"state() gave {len(row)} numbers, expected {self.spec.state_size} as after the "
                "first reset"
            )
        return row

    def _masks(
        self, observations: Mapping[Any, Any], infos: Mapping[Any, Any], alive: Bool
    ) -> Bool | None:
        if self.has_masks:
            return self.reader.masks(observations, infos, alive)
        if self.reader.has_masks(observations, infos):
            raise SchemaError(
                "an action mask came that was not there after the first reset, so that earlier "
                "states lack theirs. Let the environment give masks from its reset on."
            )
        return None
