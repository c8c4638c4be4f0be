"""What views of a dataset share: reading an episode, batches for torch, choosing episodes."""

import math
import operator
from importlib import import_module
from numbers import Real
from typing import Any

import numpy as np

from swarmdata.datasets.sampling import SampledView
from swarmdata.errors import SchemaError, UnknownNameError
from swarmdata.runtime.extras import require_extra
from swarmdata.specs.origins import Origin
from swarmdata.store import SPLITS, EpisodeTable, StoredDataset
from swarmdata.types import (
    OPTIONAL_STATE_FIELDS,
    OPTIONAL_STEP_FIELDS,
    STATE_FIELDS,
    STEP_FIELDS,
    Bool,
    Episode,
)


def stored_number(view: Any, index: Any) -> int:
    """Returns the stored number of the episode at a position of a view.

    Raises:
        IndexError: there is no such episode.
        SchemaError: the position is no whole number.
    """
    try:
        position = operator.index(index)
    except TypeError:
        raise SchemaError(
            f"a dataset got the index {index!r:.100}, expected the number of an episode or a slice "
            "such as [:3]; `filter` selects by outcome, policy and split"
        ) from None
    if not -len(view) <= position < len(view):
        raise IndexError(f"episode {position} of {len(view)} in {view!r}")
    return int(view.selection[position])


def read_episode(stored: StoredDataset, number: int) -> Episode:
    """Returns a stored episode as views of the memory map."""
    table, arrays = stored.table, stored.arrays
    first = int(table.starts[number])
    last = first + int(table.lengths[number])
    steps, states = slice(first, last), slice(first + number, last + number + 1)
    return Episode(
        **{name: arrays[name][states] for name in STATE_FIELDS},
        **{name: arrays[name][steps] for name in STEP_FIELDS},
        **{name: arrays[name][states] for name in OPTIONAL_STATE_FIELDS if name in arrays},
        **{name: arrays[name][steps] for name in OPTIONAL_STEP_FIELDS if name in arrays},
        layout=arrays["episodes/layouts"][number],
        seed=int(table.seeds[number]),
        policy=int(table.policy[number]),
        end_reason=int(table.end_reason[number]),
    )


def torch_batches(view: SampledView, **options: Any) -> Any:
    """Returns the batches of `view.sampler(**options)` for a torch `DataLoader`.

    Raises:
        MissingExtraError: torch is not installed.
        SchemaError: as the sampler.
    """
    require_extra("torch", "torch", "to_torch")
    return import_module("swarmdata.datasets.torch_batches").TorchBatches(view, **options)


def chosen(
    table: EpisodeTable,
    recipe: Origin,
    *,
    success: bool | None = None,
    min_return: float | None = None,
    max_return: float | None = None,
    policy: str | None = None,
    split: str | None = None,
) -> Bool:
    """Returns which episodes meet every given condition, [n]; as `Dataset.filter` takes them."""
    mask = outcome_mask(table, success=success, min_return=min_return, max_return=max_return)
    if policy is not None:
        mask &= policy_mask(table, recipe, policy)
    if split is not None:
        mask &= split_mask(table, split)
    return mask


def split_mask(table: EpisodeTable, split: str) -> Bool:
    """Returns which episodes are in the stored split, [n].

    Raises:
        UnknownNameError: the split is none of `SPLITS`.
    """
    if split not in SPLITS:
        raise UnknownNameError("split", split, SPLITS)
    mask: Bool = table.split == SPLITS.index(split)
    return mask


def policy_mask(table: EpisodeTable, recipe: Origin, label: str) -> Bool:
    """Returns which episodes were made by the recipe's policy `label`, [n].

    Raises:
        UnknownNameError: the recipe has no such policy.
    """
    labels = [policy.label for policy in recipe.policies]
    if label not in labels:
        raise UnknownNameError(f"policy of {recipe.id}", label, labels)
    mask: Bool = table.policy == labels.index(label)
    return mask


def outcome_mask(
    table: EpisodeTable,
    *,
    success: bool | None = None,
    min_return: float | None = None,
    max_return: float | None = None,
) -> Bool:
    """Returns which episodes ended as asked, [n]; None asks for nothing.

    Args:
        table: the episodes.
        success: whether the task was solved.
        min_return: least team return, included.
        max_return: greatest team return, included.

    Raises:
        SchemaError: a condition is not of its type.
    """
    if not isinstance(success, bool | np.bool_ | None):
        raise SchemaError(f"success is {success!r:.100}, expected True, False or None")
    bounds: dict[str, Any] = {"min_return": min_return, "max_return": max_return}
    for name, bound in bounds.items():
        if bound is not None and (not isinstance(bound, Real) or math.isnan(bound)):
            raise SchemaError(f"{name} is {bound!r:.100}, expected a number or None")
    mask = np.ones(len(table), dtype=np.bool_)
    if success is not None:
        mask &= table.success == success
    if min_return is not None:
        mask &= table.team_return >= min_return
    if max_return is not None:
        mask &= table.team_return <= max_return
    return mask
