"""Seeds of resets that the user gives none: reproducible, and never twice in a dataset."""

import hashlib
from dataclasses import dataclass

import numpy as np

from swarmdata.errors import SchemaError
from swarmdata.numerics.random import EVALUATION_BASE, derive
from swarmdata.types import Seeds

DRAWN_BITS = 31
"""Of drawn seeds; many environments take 32 bits at most."""

_EVALUATION = 1 << DRAWN_BITS
_STREAM = 6  # behind those of `seeding.STREAMS`


@dataclass(slots=True)
class SeedStream:
    """Draws seeds that were not used before.

    Attributes:
        seed: of the stream.
        used: seeds of the episodes that are there.
    """

    seed: int
    used: set[int]
    n_drawn: int = 0

    def draw(self) -> int:
        """Returns the next seed, below 2**31."""
        while True:
            value = int(derive(self.seed, _STREAM, self.n_drawn)[0]) >> (64 - DRAWN_BITS)
            self.n_drawn += 1
            if value not in self.used:
                self.used.add(value)
                return value

    def take(self, seed: int) -> int:
        """Returns a seed that the user gave, which is not drawn any more.

        Raises:
            SchemaError: it cannot be stored, or is reserved for evaluation.
        """
        if not 0 <= seed < EVALUATION_BASE:
            raise SchemaError(
                f"seed {seed} cannot be recorded: expected 0 to 2**62 - 1; the seeds from there "
                "on are reserved for evaluation."
            )
        self.used.add(int(seed))
        return int(seed)


def default_seed(id: str) -> int:
    """A seed for the dataset of this id, the same in every process, another for other ids."""
    return int.from_bytes(hashlib.sha256(id.encode()).digest()[:4], "big")


def foreign_evaluation_seeds(n_episodes: int) -> Seeds:
    """Seeds that a recorder never draws, and that fit into 32 bits, 2**31 and on, [n_episodes]."""
    return np.arange(_EVALUATION, _EVALUATION + n_episodes, dtype=np.uint64)
