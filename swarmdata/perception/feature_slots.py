"""Slots of an observation by kind: the columns of each neighbor, obstacle, message and goal.

Slots of one kind are a set; beams, cells and previews are numbered places, and read by column.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from swarmdata.errors import PolicyFitError, SchemaError
from swarmdata.perception.frames import Frame
from swarmdata.types import Double, Int

SETS = ("neighbor", "obstacle", "message", "goal", "unsearched")
"""Kinds of slots whose numbers mean nothing, or their order by distance."""

UNREAD = ("own.x", "own.y", "message.sender")
"""What means something else in teams and arenas of other sizes, and is therefore not read."""

_SLOT_FIELD = re.compile(rf"({'|'.join(SETS)})_(\d+)\.(\w+)((?:\[-\d+\])?)")


@dataclass(frozen=True, slots=True)
class SlotKind:
    """The slots of one kind, which have the same fields."""

    name: str  # such as `neighbor`; in older frames of a stack `neighbor[-1]`
    fields: tuple[str, ...]  # that are read, the mask excluded, F
    columns: tuple[tuple[int, ...], ...]  # of each slot's fields in an observation, [M][F]
    masks: tuple[int, ...]  # column of each slot's mask, [M]; empty: every slot holds something

    @property
    def n_slots(self) -> int:
        return len(self.columns)

    def index(self) -> Int:
        """The columns of the fields, [M, F]."""
        return np.array(self.columns, np.int64).reshape(self.n_slots, len(self.fields))


@dataclass(frozen=True, slots=True)
class Slots:
    """What the columns of a robot's observation describe: itself, or a slot of some kind."""

    n_columns: int  # O, what a frame adds included
    own: tuple[str, ...]  # names of what belongs to no set
    own_columns: tuple[int, ...]
    kinds: tuple[SlotKind, ...]

    @classmethod
    def parse(cls, document: Mapping[str, Any]) -> "Slots":
        """Returns what `dataclasses.asdict` made JSON values of."""
        kinds = tuple(SlotKind(**_tuples(each)) for each in document["kinds"])
        return cls(**{**_tuples(document), "kinds": kinds})

    @property
    def fields(self) -> tuple[str, ...]:
        """Names of the own features and of each kind's fields, which the slots share."""
        shared = (f"{kind.name}.{field}" for kind in self.kinds for field in kind.fields)
        return (*self.own, *shared)

    def moments(self, mean: Double, std: Double) -> tuple[Double, Double]:
        """Returns mean and deviation of each of `fields`, over the slots that hold something.

        Given are those of each column over the rows of the data, [O].
        """
        squares = std**2 + mean**2  # empty slots are zeros: a mean is over all rows
        own = list(self.own_columns)
        means, second = [mean[own]], [squares[own]]
        for kind in self.kinds:
            filled = mean[list(kind.masks)].sum() if kind.masks else float(kind.n_slots)
            share = 1 / filled if filled > 0 else 0.0
            means.append(mean[kind.index()].sum(0) * share)
            second.append(squares[kind.index()].sum(0) * share)
        centers = np.concatenate(means)
        spread = np.concatenate(second) - centers**2
        return centers, np.sqrt(np.maximum(spread, 0.0))

    def normalizing(self, mean: Double, std: Double) -> tuple[Double, Double]:
        """Returns moments of each column, [O], of moments of each of `fields`; masks stay masks."""
        return self._by_column(mean, 0.0), self._by_column(std, 1.0)

    def _by_column(self, values: Double, other: float) -> Double:
        """Values of `fields` for each column, [O]; masks and what is not read have the other."""
        out = np.full(self.n_columns, other)
        out[list(self.own_columns)] = values[: len(self.own)]
        first = len(self.own)
        for kind in self.kinds:
            out[kind.index()] = values[first : first + len(kind.fields)]
            first += len(kind.fields)
        return out

    def in_order_of(self, known: "Slots") -> "Slots":
        """Returns these slots, with kinds as a policy was trained with; absent ones have no slots.

        Raises:
            PolicyFitError: the own features, the kinds, or the fields of a kind differ.
        """
        here = {kind.name: kind for kind in self.kinds}
        absent = (SlotKind(kind.name, kind.fields, (), ()) for kind in known.kinds)
        kinds = tuple(here.pop(kind.name, kind) for kind in absent)
        found = Slots(self.n_columns, self.own, self.own_columns, kinds)
        if found.fields == known.fields and not here:
            return found
        offered = (*found.fields, *(f"slots of {name}" for name in here))
        lost = [name for name in known.fields if name not in offered]
        new = [name for name in offered if name not in known.fields]
        raise PolicyFitError(
            "the policy over sets was trained with other features; "
            f"{', '.join(lost) or 'none'} are missing here, and {', '.join(new) or 'none'} are new "
            "to it. Evaluate it in tasks and with models that differ in the numbers of slots only."
        )


def _tuples(value: Any) -> Any:
    """A mapping with tuples for its lists, at any depth of lists."""
    if isinstance(value, Mapping):
        return {key: _tuples(each) for key, each in value.items()}
    return tuple(map(_tuples, value)) if isinstance(value, list) else value


@cache
def slots_of(names: tuple[str, ...], frame: Frame | None) -> Slots:
    """Returns the slots of a robot's observation, of its features' names and what a frame adds.

    Raises:
        SchemaError: the features have no names, as those of recorded environments.
    """
    if not names:
        raise SchemaError(
            "policy_network deep_sets needs the names of features, which say what slots there are; "
            "these observations have none. Train with policy_network mlp."
        )
    every = tuple(names) if frame is None else frame.names(names)
    columns: dict[str, dict[int, dict[str, int]]] = {}  # kind -> number -> field -> column
    own: list[tuple[str, int]] = []
    for column, name in enumerate(every):
        if match := _SLOT_FIELD.fullmatch(name):
            kind, number, field, age = match.groups()
            columns.setdefault(kind + age, {}).setdefault(int(number), {})[field] = column
        else:
            own.append((name, column))
    own = [(name, column) for name, column in own if name.partition("[")[0] not in UNREAD]
    kinds = tuple(_kind(name, list(slots.values())) for name, slots in columns.items())
    return Slots(len(every), tuple(n for n, _ in own), tuple(c for _, c in own), kinds)


def _kind(name: str, slots: Sequence[dict[str, int]]) -> SlotKind:
    read = (field for field in slots[0] if f"{name.partition('[')[0]}.{field}" not in UNREAD)
    fields = tuple(field for field in read if field != "mask")
    return SlotKind(
        name,
        fields,
        tuple(tuple(slot[field] for field in fields) for slot in slots),
        tuple(slot["mask"] for slot in slots if "mask" in slot),
    )
