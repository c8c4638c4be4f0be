"""CardData: what a card is made from, with statistics of the arrays on fixed samples."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from swarmdata.analysis.coverage import N_ROWS, Coverage, coverage, sample_steps
from swarmdata.datasets.dataset import Dataset
from swarmdata.datasets.task_rewards import has_task_rewards
from swarmdata.registry.published import TaskReferences, references_of
from swarmdata.runtime.mapped_pages import take_rows
from swarmdata.specs.origins import Origin, task_of
from swarmdata.store import EpisodeTable, Manifest, StoredDataset

LOG_PROBS = "log_probs"
"""Log-probabilities of actions under their behavior policies, [T, N]; `density` defines them."""

LOG_PROB_QUANTILES = (0.01, 0.5, 0.99)


@dataclass(frozen=True, slots=True)
class LogProbabilities:
    """Log-probabilities of one policy's actions, per robot and step, nats."""

    undefined: float  # share that is not finite: actions that the policy could not have taken
    mean: float  # of the finite values; NaN if there are none
    quantiles: tuple[float, ...]  # at LOG_PROB_QUANTILES, the same


def _log_probs(stored: StoredDataset) -> dict[int, LogProbabilities] | None:
    if LOG_PROBS not in stored.arrays or not stored.arrays[LOG_PROBS].shape[1]:
        return None
    table = stored.table
    found = {}
    for policy in np.unique(table.policy).tolist():
        steps, _ = sample_steps(table, np.flatnonzero(table.policy == policy), N_ROWS)
        values = take_rows(stored.arrays[LOG_PROBS], steps).astype(np.float64).ravel()
        finite = values[np.isfinite(values)]
        known = finite if len(finite) else np.array([np.nan])
        found[policy] = LogProbabilities(
            undefined=1.0 - len(finite) / len(values),
            mean=float(known.mean()),
            quantiles=tuple(np.quantile(known, LOG_PROB_QUANTILES).tolist()),
        )
    return found


@dataclass(frozen=True, eq=False)
class CardData:
    """The content of a card; rendering adds only words."""

    manifest: Manifest
    origin: Origin
    table: EpisodeTable
    coverage: Coverage
    log_probs: dict[int, LogProbabilities] | None  # by policy index; None: not recorded
    references: TaskReferences | None
    has_task_rewards: bool
    sides: Mapping[str, EpisodeTable] = field(default_factory=dict)
    """The episodes of each side by its name, in a task of several."""
    has_events: bool = True  # else the counts of collisions are zeros that say nothing


def card_data_of(stored: StoredDataset) -> CardData:
    """Measures an open dataset of one of the package's tasks.

    A second of work at most, however large it is.

    Raises:
        SpecError: it was recorded in another environment.
    """
    spec = task_of(stored.recipe, "a card of a task")
    sides = [side.name for side in spec.sides] if len(spec.sides) > 1 else []
    return CardData(
        stored.manifest,
        stored.recipe,
        stored.table,
        coverage(stored),
        _log_probs(stored),
        references_of(spec.hash()),
        has_task_rewards(stored),
        {side: Dataset.open(stored.path, verify="none").side(side).episodes for side in sides},
        has_events=bool(stored.arrays["events"].shape[2]),
    )
