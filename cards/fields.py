"""Names, meanings and units of what is stored, for cards."""

from dataclasses import dataclass

from swarmdata.errors import SpecError
from swarmdata.sensing import state_observation_fields
from swarmdata.spec import TaskSpec


@dataclass(frozen=True)
class FieldRow:
    """One line of a card's table of features."""

    columns: str
    name: str
    unit: str
    meaning: str


_OWN = {
    "x": ("m", "own position"),
    "y": ("m", "own position"),
    "vx": ("m/s", "own velocity"),
    "vy": ("m/s", "own velocity"),
    "goal_dx": ("m", "goal minus own position"),
    "goal_dy": ("m", "goal minus own position"),
    "goal_ux": ("", "unit vector to the goal, shrinking within 0.3 m of it"),
    "goal_uy": ("", "unit vector to the goal, shrinking within 0.3 m of it"),
}

_NEIGHBOR = {
    "dx": ("m", "position relative to the own"),
    "dy": ("m", "position relative to the own"),
    "dvx": ("m/s", "velocity relative to the own"),
    "dvy": ("m/s", "velocity relative to the own"),
    "near_x": ("", "direction to it times closeness: 0 at the range, 1 in contact"),
    "near_y": ("", "direction to it times closeness: 0 at the range, 1 in contact"),
    "mask": ("", "1 if the slot holds a robot; nearest first"),
}

_OBSTACLE = {
    "near_x": ("", "direction to the nearest surface point times closeness"),
    "near_y": ("", "direction to the nearest surface point times closeness"),
    "dx": ("m", "center relative to the own position"),
    "dy": ("m", "center relative to the own position"),
    "axis_x": ("m", "local x axis times the bounding radius"),
    "axis_y": ("m", "local x axis times the bounding radius"),
    "kind": ("", "shape: 0 circle, 1/3 box, 2/3 corner, 1 pocket"),
    "mask": ("", "1 if the slot holds an obstacle; nearest first"),
}

_TABLES = {"own": _OWN, "neighbor": _NEIGHBOR, "obstacle": _OBSTACLE}


def observation_rows(spec: TaskSpec) -> list[FieldRow]:
    """The features of one robot's observation; the slots of one kind share their rows.

    Raises:
        SpecError: the observation model, or a feature of it, has no description here.
    """
    model = spec.observation
    if model.kind != "state":
        raise SpecError(f"observation model {model.kind!r} has no field descriptions for a card")
    columns: dict[tuple[str, str], list[int]] = {}
    names = state_observation_fields(model.n_neighbors, model.n_obstacles)
    for column, name in enumerate(names):
        slot, feature = name.split(".")
        columns.setdefault((slot.split("_")[0], feature), []).append(column)
    unknown = [f"{kind}.{feature}" for kind, feature in columns if feature not in _TABLES[kind]]
    if unknown:
        raise SpecError(f"observation features {unknown} have no description for a card")
    return [
        FieldRow(", ".join(map(str, where)), f"{kind}.{feature}", *_TABLES[kind][feature])
        for (kind, feature), where in columns.items()
    ]


def state_rows(spec: TaskSpec) -> list[FieldRow]:
    """The features of the state, which is for training and analysis only."""
    rows = []
    for index, agent in enumerate(spec.agent_names):
        first = 6 * index
        rows += [
            FieldRow(f"{first}–{first + 1}", f"{agent}: x, y", "m", "position"),
            FieldRow(f"{first + 2}–{first + 3}", f"{agent}: vx, vy", "m/s", "velocity"),
            FieldRow(f"{first + 4}–{first + 5}", f"{agent}: goal_x, goal_y", "m", "goal"),
        ]
    return rows
