"""Whether the rewards of a dataset are those of its task; only then its returns have a score."""

from collections.abc import Callable, Container

import numpy as np

from swarmdata.registry.components import make_task, reward_terms
from swarmdata.specs.origins.origin_kinds import Origin
from swarmdata.store import StoredDataset
from swarmdata.types import Float

N_ROWS = 1000  # joint steps that are compared; `swarmdata audit` compares all, bit for bit


def has_task_rewards(stored: StoredDataset) -> bool:
    """Applies `are_of_task` to a stored dataset."""
    return are_of_task(stored.recipe, stored.arrays, stored.arrays.__getitem__)


def are_of_task(origin: Origin, names: Container[str], rows: Callable[[str], Float]) -> bool:
    """Whether the first rewards are their terms times the weights of the spec.

    Those of a recipe are. Without recorded terms nothing can be compared, and the answer is yes.
    `names` are those of all arrays; `rows` gives one from its first joint step on.
    """
    task = origin.spec.world
    if origin.recipe is not None or task is None or "reward_terms" not in names:
        return True
    weights = np.array([term.signed_weight for term in reward_terms(make_task(task))])
    share = task.rules.rewards.team_share
    own = rows("reward_terms")[:N_ROWS].astype(np.float64) @ weights
    expected = np.empty_like(own)
    for side in task.sides:
        agents = slice(side.agents.start, side.agents.stop)
        mean = own[:, agents].mean(axis=1, keepdims=True)
        expected[:, agents] = (1.0 - share) * own[:, agents] + share * mean
    return bool(np.allclose(rows("rewards")[:N_ROWS], expected, rtol=1e-4, atol=1e-5))
