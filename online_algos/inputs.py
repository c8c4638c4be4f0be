"""How online algorithms normalize what robots see: statistics under random actions, then frozen."""

from collections.abc import Sequence

import numpy as np

from swarmdata.online_algos.worlds import Worlds
from swarmdata.types import Float

CONSTANT = 1e-3
"""Standard deviation below which a feature counts as constant and is only centered."""


def measure_inputs(
    worlds: Worlds, generators: Sequence[np.random.Generator], n_steps: int
) -> tuple[Float, Float]:
    """Plays uniform random actions and returns mean and deviation of what each seed's robots see.

    Args:
        worlds: are advanced by `n_steps`.
        generators: of the actions, one for each seed.
        n_steps: how many.

    Returns:
        Mean and standard deviation, float32 [K, O]; the deviation of a constant feature is 1.
    """
    sizes, seen = worlds.sizes, []
    shape = (worlds.n_copies, sizes.n_agents, sizes.action)
    for _ in range(n_steps):
        actions = np.stack([generator.uniform(-1.0, 1.0, shape) for generator in generators])
        seen.append(worlds.seen(worlds.advance(actions)))
    rows = np.stack(seen, axis=1).reshape(worlds.n_seeds, -1, sizes.observation)
    std = rows.std(axis=1, dtype=np.float64)
    mean = rows.mean(axis=1, dtype=np.float64)
    return mean.astype(np.float32), np.where(std > CONSTANT, std, 1.0).astype(np.float32)
