"""Selects episodes by split, by outcome and by the policy that made them."""

import numpy as np

from swarmdata.errors import UnknownNameError
from swarmdata.specs.origins import Origin
from swarmdata.store import SPLITS, EpisodeTable
from swarmdata.types import Bool


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
    """
    mask = np.ones(len(table), dtype=np.bool_)
    if success is not None:
        mask &= table.success == success
    if min_return is not None:
        mask &= table.team_return >= min_return
    if max_return is not None:
        mask &= table.team_return <= max_return
    return mask
