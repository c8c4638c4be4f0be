"""Names, meanings and units of what is stored, for cards."""

import re
from dataclasses import dataclass

from swarmdata.errors import SpecError
from swarmdata.features import UNITS
from swarmdata.interfaces import Task
from swarmdata.observing import Observer
from swarmdata.states import BODY, N_COLUMNS


@dataclass(frozen=True)
class FieldRow:
    """One line of a card's table of features."""

    columns: str
    name: str
    unit: str
    meaning: str


def observation_rows(task: Task) -> list[FieldRow]:
    """The features of one robot's observation; slots of one kind and stacked frames share rows.

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


_ROBOT = (
    ("x, y", "m", "position"),
    ("vx, vy", "m/s", "velocity"),
    ("ux, uy", "", "heading, a unit vector; (1, 0) of a holonomic robot"),
    ("tx, ty", "m", "target: where the robot should be now"),
)

_BODY = (
    ("x, y", "m", "position of the payload"),
    ("vx, vy", "m/s", "velocity of the payload"),
    ("ux, uy", "", "direction of the payload's local x axis"),
    ("turn_rate", "rad/s", "turn rate of the payload"),
)


def state_rows(task: Task) -> list[FieldRow]:
    """The features of the state, which is for training and analysis only."""
    rows = []
    for index, agent in enumerate(task.spec.agent_names):
        for k, (names, unit, meaning) in enumerate(_ROBOT):
            first = N_COLUMNS * index + 2 * k
            rows.append(FieldRow(f"{first}–{first + 1}", f"{agent}: {names}", unit, meaning))
    start = N_COLUMNS * task.spec.n_agents
    for body in range(len(task.movables)):
        for k, (names, unit, meaning) in enumerate(_BODY):
            first = start + len(BODY) * body + 2 * k
            last = f"–{first + 1}" if "," in names else ""
            rows.append(FieldRow(f"{first}{last}", f"payload: {names}", unit, meaning))
    start += len(BODY) * len(task.movables)
    return rows + [
        FieldRow(str(start + k), name, "", "of the task; see its rules")
        for k, name in enumerate(task.extras)
    ]
