"""Rows that an actor clones, drawn in proportion to exponential weights of their advantages.

Advantage-weighted cloning minimizes the mean of w_r e_r over rows r, one row for each robot and
step, with w_r = min(exp(beta A_r), 100) and e_r the error of the actor. With the weights as factors
of the loss, a batch counts as no more than

    n_eff = (sum_r w_r)^2 / sum_r w_r^2

rows (Kish 1965), which can be a tenth of it: gradients are noisy, and few rows drive Adam. So

- beta is the setting, or less where n_eff would be below `effective_share` of the rows;
- rows are drawn in proportion to their weights, one batch from the last 1 / `effective_share`
  batches, which together hold about one batch of effective rows, and are cloned without factors.

Each batch is scored once, when critics learn from it. Each robot's rows are drawn for themselves,
by systematic draws (Kitagawa 1996, "Monte Carlo filter and smoother"): a row is drawn as often as
its share of the weights says, rounded up or down. With a memory, whole segments are drawn by the
sum of their weights, and in those each robot's steps by the weight over its segment's sum.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, replace
from typing import Any

import torch
from torch import Tensor

from swarmdata.errors import SchemaError
from swarmdata.learn.memory.segments import each_field, taken
from swarmdata.learn.networks.network_inputs import uniform_like
from swarmdata.types import Batch

Along = Callable[[Batch], tuple[Batch, Tensor]]
"""Of an actor, such as `StackedActor.along`: returns transitions and its outputs there."""

LARGEST_WEIGHT = 100.0
"""Of a row; Kostrikov et al. 2022, appendix B."""

HALVINGS = 14
"""Of the range of beta on a logarithmic scale, which leaves 0.1 % of it."""

ABSENT = -1e30
"""Instead of the advantage of a robot that has left: its weight is 0."""

SMALLEST = 1e-6
"""End of that range, over its beginning."""


def check_share(effective_share: float) -> None:
    """Raises SchemaError unless a share of the rows is above 0 and at most 1."""
    if not 0 < effective_share <= 1:
        raise SchemaError(
            f"effective_share is {effective_share}, expected above 0 and at most 1: the part of "
            "the rows that the weights leave effective"
        )


def effective_share_of(weights: Tensor) -> Tensor:
    """Returns n_eff over the number of rows, [K], of weights [K, ...]."""
    flat = weights.flatten(1)
    return flat.mean(1).square() / flat.square().mean(1)


@torch.no_grad()
def row_weights(
    advantages: Tensor, largest: float | Tensor, effective_share: float
) -> tuple[Tensor, Tensor]:
    """Returns the weight of each row over the largest, [K, M, N], and beta, [K], one of a seed.

    Advantages are [K, M, N], `ABSENT` of robots that have left; `largest` is beta's limit, finite,
    a number or [K]; `effective_share` the least n_eff over the number of the other rows.
    """
    flat = advantages.flatten(1)  # [K, M N]
    share = effective_share * (flat > ABSENT).float().mean(1)

    def weights(beta: Tensor) -> Tensor:
        logs = (beta[:, None] * flat).clamp(max=math.log(LARGEST_WEIGHT))
        return (logs - logs.amax(1, keepdim=True)).exp() * (flat > ABSENT)

    def is_enough(beta: Tensor) -> Tensor:
        return effective_share_of(weights(beta)) >= share

    high = torch.as_tensor(largest, dtype=flat.dtype, device=flat.device).expand(len(flat))
    low = torch.where(is_enough(high), high, SMALLEST * high)
    for _ in range(HALVINGS):
        beta = (low * high).sqrt()
        enough = is_enough(beta)
        low, high = torch.where(enough, beta, low), torch.where(enough, high, beta)
    return weights(low).view_as(advantages), low


def draw(weights: Tensor, n_drawn: int, generators: Sequence[torch.Generator]) -> Tensor:
    """Returns D = `n_drawn` rows for each robot, [K, D, N], in proportion to weights [K, M, N].

    A robot whose weights are all 0 gets all rows alike; there is one generator for each seed.
    """
    weights = weights + (weights.sum(1, keepdim=True) == 0)
    cumulative = weights.transpose(1, 2).double().cumsum(2)  # [K, N, M]
    start = uniform_like(generators, weights[:, 0])  # [K, N]
    steps = torch.arange(n_drawn, device=weights.device, dtype=torch.float64)
    places = (steps + start[..., None]) / n_drawn * cumulative[..., -1:]
    last = weights.shape[1] - 1
    rows = torch.searchsorted(cumulative, places, right=True).clamp(max=last)
    return rows.transpose(1, 2)


class ScoredRows:
    """The last batches of K seeds and the advantages of their rows, from which actors learn.

    `effective_share` is the least effective sample size of the weights over their number.
    """

    def __init__(self, effective_share: float, generators: Sequence[torch.Generator]) -> None:
        check_share(effective_share)
        self._share, self._generators = effective_share, generators
        self._n_kept = math.ceil(1 / effective_share - 1e-9)  # batches, M
        self._n_added = 0
        empty = torch.zeros(len(generators), 0)
        self._kept = dict.fromkeys(("observations", "actions", "mask", "advantages"), empty)

    def add(self, batch: Batch, advantages: Tensor, alive: Tensor | None = None) -> None:
        """Adds a batch, always of the same shape, in place of the oldest.

        Advantages, [K, R, N], without a gradient, are of the transitions [K, B, ...], or of the
        steps that windows [K, B, L, ...] are learned from. Rows of robots that have left, which
        `alive`, [K, R, N], says, are not drawn.
        """
        if alive is not None:
            advantages = advantages.masked_fill(~alive, ABSENT)
        for name in self._kept:
            new = advantages if name == "advantages" else getattr(batch, name)
            if not self._n_added:
                self._kept[name] = new[:, None].repeat_interleave(self._n_kept, 1)
            self._kept[name][:, self._n_added % self._n_kept] = new
        self._n_added += 1

    def draw(self, along: Along, largest: float | Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Returns as many rows as a batch has: actions, [K, R, N, A], the actor's outputs, beta.

        `along` is that of the actor; `largest` is beta's limit, a number or [K].
        """
        n_batches = min(self._n_added, self._n_kept)
        kept = {name: values[:, :n_batches].flatten(1, 2) for name, values in self._kept.items()}
        weights, beta = row_weights(kept.pop("advantages"), largest, self._share)
        rest = [field.name for field in fields(Batch) if field.name not in kept]
        batch = Batch(**kept, **dict.fromkeys(rest))
        n_drawn = batch.mask.shape[1] // n_batches
        draw_from = self._draw_steps if batch.mask.ndim == 3 else self._draw_rows
        return *draw_from(along, batch, weights, n_drawn), beta

    def _draw_rows(
        self, along: Along, batch: Batch, weights: Tensor, n: int
    ) -> tuple[Tensor, Tensor]:
        rows = draw(weights, n, self._generators)
        drawn = {
            "observations": taken(batch.observations, rows),
            "actions": taken(batch.actions, rows),
            "mask": batch.mask[:, :n],
        }
        steps, outputs = along(replace(batch, **drawn))
        return steps.actions, outputs

    def _draw_steps(
        self, along: Along, batch: Batch, weights: Tensor, n: int
    ) -> tuple[Tensor, Tensor]:
        k, n_segments = batch.mask.shape[:2]
        by_segment = weights.view(k, n_segments, -1, weights.shape[2])  # [K, M B, T, N]
        totals = by_segment.sum((2, 3))  # [K, M B]
        segments = draw(totals[..., None], n, self._generators)[..., 0]  # [K, B]
        steps, outputs = along(each_field(batch, lambda values: taken(values, segments)))
        left = taken(by_segment / totals[..., None, None], segments).flatten(1, 2)  # [K, R, N]
        rows = draw(left, left.shape[1], self._generators)
        return taken(steps.actions, rows), taken(outputs, rows)

    def state_dict(self) -> dict[str, Tensor]:
        state = {f"scored_{name}": values.clone() for name, values in self._kept.items()}
        return {"n_scored": torch.tensor(self._n_added), **state}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Restores what `state_dict` returned; runs that drew no rows have none, and only act."""
        if "n_scored" not in state:
            return
        self._n_added = int(state["n_scored"])
        for name in self._kept:
            self._kept[name] = state[f"scored_{name}"].to(self._generators[0].device, copy=True)
