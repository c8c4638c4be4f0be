"""Divergence: training that left the finite numbers is stopped, and never becomes a checkpoint."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from swarmdata.errors import DivergedError


def check_finite(values: Mapping[str, Any], what: str, now: int, folder: Path) -> None:
    """Checks that there are no infinite and no undefined numbers.

    Args:
        values: numbers and tensors by name.
        what: what they belong to, for the message.
        now: the update, or the joint steps of a seed, that they are of.
        folder: of the run.

    Raises:
        DivergedError: there are some; the message names them, and what was kept.
    """
    wrong = [
        f"{name} is {_shown(value)}" for name, value in values.items() if not _is_finite(value)
    ]
    if wrong:
        more = f", and {len(wrong) - 3} more" if len(wrong) > 3 else ""
        raise DivergedError(
            f"training diverged in {folder}: at {now:,}, of {what}, {', '.join(wrong[:3])}{more}. "
            "It was stopped, and the last good checkpoint is kept. Train in another folder with "
            "a smaller learning_rate or max_grad_norm, or with smaller rewards."
        )


def _is_finite(value: Any) -> bool:
    if isinstance(value, Tensor):
        return not value.is_floating_point() or bool(torch.isfinite(value).all())
    return math.isfinite(value)


def _shown(value: Any) -> str:
    if not isinstance(value, Tensor):
        return str(value)
    n_wrong = int((~torch.isfinite(value)).sum())
    return f"not finite in {n_wrong:,} of {value.numel():,} numbers"
