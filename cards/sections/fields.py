"""Names, meanings and units of the stored columns, for cards."""

import re
from dataclasses import dataclass

from swarmdata.errors import SpecError
from swarmdata.interfaces import Task
from swarmdata.perception.observer import Observer
from swarmdata.specs.features import UNITS
from swarmdata.specs.state_layout import N_COLUMNS, ROBOT
from swarmdata.store.arrays.column_meanings import state_columns
from swarmdata.types import Column


@dataclass(frozen=True)
class FieldRow:
    """One line of a card's table of features."""

    columns: str
    name: str
    unit: str
    meaning: str


def observation_rows(task: Task) -> list[FieldRow]:
    """The features of one robot's observation; slots of a kind, and stacked frames, share a row.

    Raises:
        SpecError: a feature has no description.
    """
    features = Observer(task, 1).features
    columns: dict[str, list[int]] = {}
    for column, feature in enumerate(features):
        name = re.sub(r"_\d+(?=\.)", "_*", re.sub(r"\[-\d+\]$", "", feature.name))
        columns.setdefault(name, []).append(column)
    unknown = sorted({feature.name for feature in features if not feature.meaning})
    if unknown:
        raise SpecError(f"observation features {unknown} have no description for a card")
    rows = []
    for name, where in columns.items():
        first = features[where[0]]
        rows.append(FieldRow(_columns(where), name, UNITS.get(first.kind, ""), first.meaning))
    return rows


def _columns(columns: list[int]) -> str:
    """Column numbers; if there are many, the first two and the last: `8, 12, … 68`."""
    if len(columns) <= 4:
        return ", ".join(map(str, columns))
    return f"{columns[0]}, {columns[1]}, … {columns[-1]}"


def state_rows(task: Task) -> list[FieldRow]:
    """The columns of the state."""
    columns, n = state_columns(task), task.spec.n_agents
    robots = [
        FieldRow(f"{N_COLUMNS} i + {k}", f"robot i: {name}", *_described(columns[k]))
        for k, name in enumerate(ROBOT)
    ]
    return robots + [
        FieldRow(str(k), columns[k].name, *_described(columns[k]))
        for k in range(N_COLUMNS * n, len(columns))
    ]


def _described(column: Column) -> tuple[str, str]:
    return column.unit, column.meaning
