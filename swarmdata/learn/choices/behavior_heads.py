"""Behavior heads: the data's distribution over choices, and rules that choose near it.

A head is factored, with one distribution per column of a robot's action, or joint, with one over
all combinations of its columns. Left and right of an obstacle may both be fine and the middle not:
a factored head of two columns admits the middle, a joint one does not.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import torch
from torch import Tensor
from torch.nn.functional import one_hot

from swarmdata.errors import SchemaError
from swarmdata.learn.choices import bins
from swarmdata.learn.choices.choices import Choices

Regulariser = Literal["none", "bc", "bcq", "cql"]
"""What keeps an offline learner near its data."""

Head = Literal["factored", "joint"]
"""One distribution per column of a robot's action, or one of all columns together."""


def head_size(choices: Choices, head: Head) -> int:
    """Outputs of a behavior network for one robot, H: D C, or C ** D of a joint head."""
    return choices.n_columns * choices.n_choices if head == "factored" else choices.n_combinations


def behavior_log_probs(outputs: Tensor, choices: Choices, head: Head) -> Tensor:
    """Returns log pi_b of all choices: [..., N, D, C], or [..., N, C ** D] of a joint head.

    Outputs are [..., N, H]; choices that do not exist have probability 0.
    """
    exists = choices.exists
    if head == "factored":
        outputs = outputs.reshape(*outputs.shape[:-1], choices.n_columns, choices.n_choices)
    elif exists is not None:
        exists = combinations(exists.to(outputs.dtype), torch.mul) > 0
    if exists is not None:
        outputs = outputs.masked_fill(~exists, -math.inf)
    return outputs.log_softmax(-1)


def cross_entropy(log_probs: Tensor, weights: Tensor, head: Head) -> Tensor:
    """Returns -log pi_b of recorded actions, [..., N], in nats, summed over columns.

    Actions are weights of the choices, [..., N, D, C]: `Choices.weights`.
    """
    wanted = combinations(weights, torch.mul) if head == "joint" else weights
    parts = wanted * log_probs.masked_fill(wanted == 0, 0.0)  # 0 log 0 is 0
    return -parts.flatten(wanted.ndim - (1 if head == "joint" else 2)).sum(-1)


@dataclass(frozen=True, slots=True)
class Rule:
    """How robots act, in the targets of learning and in the world alike.

    With utilities U of a column's choices and the data's pi_b:

        none, cql   argmax U
        bc          p = softmax(U / temperature + log pi_b): argmax p of recorded choices,
                    the mean sum_k p_k bin_k of bins
        bcq         argmax U  where  pi_b >= threshold max pi_b

    (Beeson, Ireland & Montana 2024, section 4.) There `bc` takes argmax p of bins, too; the mean is
    the better copy of a continuous action, which lies up to half a bin's width from every bin. A
    joint head adds the columns' U and has one p of all combinations; its threshold is that of one
    column to the power of D.
    """

    regulariser: Regulariser  # which of them
    temperature: float  # lambda of `bc`, in units of utilities
    threshold: float  # of `bcq`, 0 to 1
    head: Head  # kind of the behavior head

    def __post_init__(self) -> None:
        if self.temperature <= 0 or not 0 <= self.threshold <= 1:
            raise SchemaError(f"{self}: expected temperature above 0 and threshold from 0 to 1")

    @property
    def has_behavior(self) -> bool:
        return self.regulariser in ("bc", "bcq")

    def act(
        self,
        utilities: Tensor,
        log_probs: Tensor | None,
        choices: Choices,
        allowed: Tensor | None = None,
    ) -> Tensor:
        """Returns the actions as weights of the choices, [..., N, D, C]: `Choices.weights`.

        Utilities are [..., N, D, C]; log_probs those of `behavior_log_probs`, None without a head;
        `allowed` what the environment allows now, bool [..., N, D, C], None all.
        """
        is_joint = self.has_behavior and self.head == "joint"
        mask = choices.exists if allowed is None else allowed
        if mask is not None:
            if choices.exists is not None:
                mask = mask & choices.exists
            utilities = utilities.masked_fill(~mask, -math.inf)
        if is_joint:
            utilities = combinations(utilities, torch.add)  # [..., N, C ** D]
        if log_probs is not None:
            # the best of what is allowed is what the threshold is relative to
            log_probs = log_probs.masked_fill(utilities == -math.inf, -math.inf)
            utilities = self._near(utilities, log_probs, choices.n_columns if is_joint else 1)
        if self.regulariser == "bc" and choices.is_continuous:
            probs = utilities.softmax(-1)
            by_column = marginals(probs, choices) if is_joint else probs
            mean = (by_column * choices.values.to(by_column.dtype)).sum(-1)
            return bins.two_hot(mean, choices.n_choices)
        best = utilities.argmax(-1)
        columns = split(best, choices) if is_joint else best  # [..., N, D]
        return one_hot(columns, choices.n_choices).to(utilities.dtype)

    def _near(self, utilities: Tensor, log_probs: Tensor, n_columns: int) -> Tensor:
        """Preferences that stay near the data."""
        if self.regulariser == "bc":
            return utilities / self.temperature + log_probs
        if self.threshold == 0:
            return utilities
        least = log_probs.amax(-1, keepdim=True) + n_columns * math.log(self.threshold)
        return utilities.masked_fill(log_probs < least, -math.inf)


def combinations(values: Tensor, join: Callable[[Tensor, Tensor], Tensor]) -> Tensor:
    """Returns a value of every combination of one choice per column, [..., C ** D].

    `join`, torch.add or torch.mul, joins the columns' values, [..., D, C].
    """
    joined = values[..., 0, :]
    for column in range(1, values.shape[-2]):
        joined = join(joined[..., :, None], values[..., column, None, :]).flatten(-2)
    return joined


def split(combination: Tensor, choices: Choices) -> Tensor:
    """Returns the choices, [..., D], that numbers of combinations, [...], are made of."""
    c, d = choices.n_choices, choices.n_columns
    return torch.stack([combination // c ** (d - 1 - k) % c for k in range(d)], -1)


def marginals(probs: Tensor, choices: Choices) -> Tensor:
    """Returns each column's probabilities, [..., D, C], of those of combinations, [..., C ** D]."""
    c, d = choices.n_choices, choices.n_columns
    table = probs.reshape(*probs.shape[:-1], *[c] * d)
    axes = [table.ndim - d + column for column in range(d)]
    others = ([axis for axis in axes if axis != column] for column in axes)
    return torch.stack([table.sum(each) if each else table for each in others], -2)
