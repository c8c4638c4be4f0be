"""MemorySettings, whether a policy remembers, and the windows that it learns from."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

from swarmdata.errors import SchemaError

Memory = Literal["none", "gru"]
"""What a policy acts on: the present observation, or all of the episode so far."""


@dataclass(frozen=True)
class WindowSettings:
    """The windows of episodes that a policy with a memory learns from."""

    burn_in: int = 10  # steps before a segment that bring the memory up to date; no loss
    window: int = 20  # steps of a segment, which the loss is over; `batch_size` counts them

    @property
    def has_memory(self) -> bool:
        return True

    def n_windows(self, batch_size: int) -> int:
        """Returns how many segments have as many steps as a batch of transitions."""
        if batch_size < self.window:
            raise SchemaError(
                f"batch_size is {batch_size} and window {self.window}: a batch has less than one "
                "segment. Raise batch_size or lower window."
            )
        return batch_size // self.window


@dataclass(frozen=True)
class MemorySettings(WindowSettings):
    """Settings of policies that may have a memory; without one, only `memory` matters."""

    NEEDS: ClassVar[Mapping[str, Any]] = dict.fromkeys(
        ("burn_in", "window", "memory_size"), ("memory", ("gru",))
    )

    memory: Memory = "none"
    memory_size: int = 64  # numbers that each robot remembers

    @property
    def has_memory(self) -> bool:
        return self.memory != "none"
