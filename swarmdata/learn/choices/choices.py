"""Choices that each robot has: bins of continuous actions, or recorded choices."""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn.functional import one_hot

from swarmdata.errors import SchemaError
from swarmdata.learn.choices import bins
from swarmdata.learn.networks.setup import Sizes

MOST_COMBINATIONS = 4096
"""Most combinations of choices of one robot that are listed."""


@dataclass(frozen=True, slots=True, eq=False)
class Choices:
    """C choices in each of D columns of N robots' actions.

    Robots may differ: who has fewer choices in a column has padding, which `exists` marks, and a
    column that a robot does not have is a single choice, 0.
    """

    values: Tensor  # of the actions that the choices mean, float64 [N, D, C], 0 in padding
    exists: Tensor | None  # bool [N, D, C]; None where there is no padding
    is_continuous: bool  # whether they are bins, between which recorded actions lie

    @classmethod
    def of(cls, sizes: Sizes, n_bins: int, device: torch.device | str = "cpu") -> "Choices":
        """The choices of a dataset: its own, or `n_bins` in each column of continuous actions."""
        if not sizes.choices:
            values = bins.bin_values(n_bins, torch.float64).to(device)
            return cls(values.expand(sizes.n_agents, sizes.action, -1), None, True)
        return cls.recorded(sizes.choices, sizes.action, device)

    @classmethod
    def recorded(
        cls, ranges: Sequence[Sequence[range]], n_columns: int, device: torch.device | str = "cpu"
    ) -> "Choices":
        """The choices of a recorded environment, `Sizes.choices`, in `n_columns` columns."""
        columns = [[*agent, *[range(1)] * (n_columns - len(agent))] for agent in ranges]
        most = max(len(choices) for agent in columns for choices in agent)
        values = torch.zeros(len(columns), n_columns, most, dtype=torch.float64)
        exists = torch.zeros_like(values, dtype=torch.bool)
        for i, agent in enumerate(columns):
            for d, choices in enumerate(agent):
                values[i, d, : len(choices)] = torch.tensor(list(choices), dtype=torch.float64)
                exists[i, d, : len(choices)] = True
        is_full = bool(exists.all())
        return cls(values.to(device), None if is_full else exists.to(device), False)

    @property
    def n_columns(self) -> int:
        return self.values.shape[1]

    @property
    def n_choices(self) -> int:
        """Choices in a column, C."""
        return self.values.shape[2]

    @property
    def n_combinations(self) -> int:
        """Combinations of one robot's choices in all columns, C ** D."""
        number = self.n_choices**self.n_columns
        if number > MOST_COMBINATIONS:
            raise SchemaError(
                f"{self.n_choices} choices in {self.n_columns} columns have {number:,} "
                f"combinations, expected at most {MOST_COMBINATIONS:,}. Use a factored behavior "
                "head, or fewer choices."
            )
        return number

    def weights(self, actions: Tensor) -> Tensor:
        """Returns recorded actions [..., N, D] as weights of the choices, float32 [..., N, D, C].

        Continuous ones lie between two bins (`bins.two_hot`). Recorded choices have one weight,
        1; robots that have left have zeros recorded, which count as their first choice.
        """
        if self.is_continuous:
            return bins.two_hot(actions, self.n_choices)
        places = (actions - self.values[..., 0]).round().long().clamp(0, self.n_choices - 1)
        return one_hot(places, self.n_choices).to(torch.float32)

    def to_actions(self, weights: Tensor) -> Tensor:
        """Returns the actions, float64 [..., N, D], that weights [..., N, D, C] mean."""
        return (weights * self.values).sum(-1)

    def to_cpu(self) -> "Choices":
        """The same in the CPU's memory, for acting."""
        exists = None if self.exists is None else self.exists.cpu()
        return Choices(self.values.cpu(), exists, self.is_continuous)


def columns_of(joined: Tensor, choices: Sequence[Sequence[range]], n_columns: int) -> Tensor:
    """Returns action masks by column, bool [..., N, D, C].

    As recorded, `joined` has a robot's choices of all columns one after the other, then padding,
    bool [..., N, M]. Columns that a robot lacks have one choice, which is always allowed.
    """
    most = max(len(column) for agent in choices for column in agent)
    masks = joined.new_zeros(*joined.shape[:-1], n_columns, most)
    masks[..., 0] = True
    for i, agent in enumerate(choices):
        start = 0
        for d, column in enumerate(agent):
            masks[..., i, d, : len(column)] = joined[..., i, start : start + len(column)]
            start += len(column)
    return masks
