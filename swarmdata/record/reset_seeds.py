"""Seeds for resets without one: reproducible, and never twice in a dataset."""

import hashlib
from dataclasses import dataclass

import numpy as np

from swarmdata.errors import SchemaError
from swarmdata.numerics.random import EVALUATION_BASE, STREAMS, derive
from swarmdata.types import Seeds

DRAWN_BITS = 31  # bits of drawn seeds; many environments accept at most 32 bits

_RESET_STREAM = STREAMS["reset"]


@dataclass(slots=True)
class SeedStream:
    """Draws seeds that were not used before."""

    seed: int  # seed of the stream itself
    used: set[int]  # seeds of the recorded episodes
    n_drawn: int = 0

    def draw(self) -> int:
        """Returns an unused seed below 2**31."""
        while True:
            value = int(derive(self.seed, _RESET_STREAM, self.n_drawn)[0]) >> (64 - DRAWN_BITS)
            self.n_drawn += 1
            if value not in self.used:
                self.used.add(value)
                return value

    def take(self, seed: int) -> int:
        """Marks the user's seed as used and returns it; SchemaError if it cannot be stored."""
        if not 0 <= seed < EVALUATION_BASE:
            raise SchemaError(
                f"seed {seed} cannot be recorded: expected 0 to 2**62 - 1; larger seeds are "
                "reserved for evaluation."
            )
        self.used.add(int(seed))
        return int(seed)


def default_seed(id: str) -> int:
    """A seed that depends on the dataset's id only."""
    return int.from_bytes(hashlib.sha256(id.encode()).digest()[:4], "big")


def foreign_evaluation_seeds(n_episodes: int) -> Seeds:
    """Seeds from 2**31 on: they fit into 32 bits, and recorders never draw them, [n_episodes]."""
    first = 1 << DRAWN_BITS
    return np.arange(first, first + n_episodes, dtype=np.uint64)
