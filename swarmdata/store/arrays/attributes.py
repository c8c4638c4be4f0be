"""The Zarr attributes of every array: what it and its columns mean, for who has Zarr only."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from swarmdata.interfaces import Task
from swarmdata.numerics.geometry import SHAPE_MEANINGS
from swarmdata.registry.components import make_task, reward_terms
from swarmdata.specs.origins import Origin, Spec
from swarmdata.specs.sensing_models import Drift
from swarmdata.specs.spaces import width
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.store.arrays.column_meanings import action_columns, task_columns, term_columns
from swarmdata.store.arrays.layout import ALL_FIELDS, ROW_MEANINGS, Field
from swarmdata.store.table import SPLITS
from swarmdata.types import END_REASONS, SEPARATION_GAP, TASK_END_REASONS, Column

Attributes = dict[str, Any]
Shapes = Mapping[str, tuple[int, ...]]

FRAME_MEANINGS = {
    "world": "origin at the arena's centre, x along its width, y along its height",
    "body": "origin at the robot's centre, x along its heading, y to its left",
}
"""Frames of reference that columns name."""

LOG_PROBS_FORMULA = (
    "The sum over the action's components. Of one strictly inside (-1, 1): the logarithm of the "
    "density of the Gaussian action noise. Of one at -1 or 1: the logarithm of the probability of "
    "being clipped to it. Without noise: 0. Of a uniform draw from [-1, 1]: -log 2."
)
"""What `log_probs` mean where the policies are the package's."""

REWARD_FORMULA = (
    "The reward of an agent is (1 - team_share) times the sum of its `terms` plus team_share times "
    "the mean of these sums over the agents. In a formula [x] is 1 where x holds, else 0."
)

TERMS_FORMULA = (
    "`rewards` follow from these bit for bit, in float64: own = 0; for each column in order, own = "
    "own + sign * weight * value; mean = the sum of own over the agents in order, divided by their "
    "number; reward = (1 - team_share) * own + team_share * mean, rounded to float32."
)
"""What `numerics.weighted_terms` computes."""


def sides_note(spec: TaskSpec) -> str:
    """What the formulas mean by the agents in a task of several sides; empty for one team."""
    if len(spec.sides) == 1:
        return ""
    sides = ", ".join(
        f"{side.name} {side.agents.start} to {side.agents.stop - 1}" for side in spec.sides
    )
    return f" The mean is over the agents of the same side: {sides}."


PRECISION_NOTE = (
    "The terms are computed from the float32 states and the events, partly in float32, and rounded "
    "to float32. Terms and rewards that are computed again in float64 agree within 1e-5, except in "
    "steps in which a length is within 1e-6 m of a threshold in [ ]."
)
"""How well rewards can be computed again, as `tests/examples/read_with_zarr.py` does."""

RECORDED_LAYOUT = (
    "How a value of a space becomes columns: a box's numbers in C order; a discrete choice as its "
    "number; the parts of a dictionary in the order of its sorted keys. An agent whose space is "
    "smaller than the widest one has zeros in the remaining columns."
)
"""What the columns of a recording of another environment are."""

EMPTY_AXIS_NOTE = "An axis has length 0: there is nothing of the kind in this dataset."

END_REASON_MEANINGS = (
    "success: the task was solved; failure: a failure that the task's spec names, a termination as "
    "well; horizon: cut at the horizon, a truncation; ended: a termination of an environment that "
    "does not say whether its task was solved."
)
"""What the codes of `episodes/end_reason` mean."""

SENSED_NOTES = {
    "state": (
        "Vectors are in the world's frame. Slots of neighbors and obstacles are in the order of "
        "the gap between surfaces, the nearest first; a slot without a return is zero."
    ),
    "lidar": (
        "Vectors are in the robot's body frame. Beam k of n points 2 pi k / n counter-clockwise "
        "from the heading."
    ),
    "bearing": (
        "Vectors are in the robot's body frame. Slots of neighbors are in the order of the "
        "distance between centres, the nearest first; a slot without a return is zero."
    ),
    "occupancy": (
        "Vectors are in the robot's body frame. Cell r n + c of n x n has its centre "
        "(r - (n - 1) / 2) cell sizes ahead of the robot and (c - (n - 1) / 2) to its left."
    ),
}
"""How each observation model is laid out."""

MODIFIED_NOTE = (
    "`model` has the numbers of the model: standard deviations of the noise by kind of measurement "
    "(m, m/s, rad), from which all features are computed; probability that an object, beam or cell "
    "is missed; steps of delay; frames in the stack. A name that ends in [-k] is of the frame k "
    "steps before. message_k is from the k-th of the other agents in their order."
)
"""What holds of every observation model."""

BODY_STATE_NOTE = SENSED_NOTES["state"].replace("the world's", "the robot's body")
"""Of states in the body's frame."""

DRIFT_NOTE = (
    "A robot knows its pose in the first state of an episode, and within `landmarks` (m) of a "
    "corner or the middle of the arena. Else it adds up its displacements and turns, measured "
    "with errors: in a step of d m and a turn of a rad, the displacement is measured as (1 + p "
    "B0) times the true one plus p sqrt(d) (W0, W1), the turn as a + h B1 d + t B2 a + sqrt(h^2 "
    "d + t^2 |a|) W2, with p, h, t the numbers `position`, `heading`, `turning` of `drift`, B "
    "normal draws of the episode and W of the step; a robot that is not a unicycle measures "
    "turns exactly. Its position, its heading and places in the world's frame are as it "
    "believes, what it measures from its body is not."
)
"""What `drift` means."""

_CODES = {"episodes/split": SPLITS, "episodes/end_reason": END_REASONS}


def attributes_of(origin: Origin, shapes: Shapes) -> dict[str, Attributes]:
    """The attributes of each array of `shapes`.

    An array whose width is not that of the spec gets no columns: they would be wrong.

    Raises:
        SpecError: the spec contradicts itself.
    """
    spec = origin.spec
    if spec.world is None:
        known = _of_recording(spec, shapes)
    else:
        known = _of_task(make_task(spec.world), shapes)
    if origin.recipe is not None:
        known["log_probs"] = {"details": LOG_PROBS_FORMULA}
        known["episodes/end_reason"] = {"codes": list(TASK_END_REASONS)}
    known.setdefault("episodes/end_reason", {})["details"] = END_REASON_MEANINGS
    known["episodes/policy"] = {"codes": [policy.label for policy in origin.policies]}
    return {
        name: {**_of_field(name, shape, spec.agent_names), **known.get(name, {})}
        for name, shape in shapes.items()
    }


def _of_field(name: str, shape: tuple[int, ...], agents: Sequence[str]) -> Attributes:
    """What holds of an array in every dataset."""
    field = ALL_FIELDS[name]
    found: Attributes = {"meaning": field.meaning, "rows": ROW_MEANINGS[field.rows]}
    if "agent" in field.dimensions:
        found["agents"] = list(agents)
    if field.dtype != "bool" and (field.unit or (field.low, field.high) != (None, None)):
        found["range"] = _range(field)
    if name in _CODES:
        found["codes"] = list(_CODES[name])
    if 0 in shape[1:]:
        found["empty"] = EMPTY_AXIS_NOTE
    return found


def _of_task(task: Task, shapes: Shapes) -> dict[str, Attributes]:
    spec = task.spec
    known: dict[str, Attributes] = {
        name: _of_columns(columns)
        for name, columns in task_columns(task).items()
        if columns and shapes.get(name, (0,))[-1] == len(columns)
    }
    known.setdefault("states", {}).update(
        agents=list(spec.agent_names),
        radius={"value": [robot.radius for robot in spec.robots], "unit": "m"},
        arena={"value": [spec.arena.width, spec.arena.height], "unit": "m"},
    )
    known.setdefault("observations", {}).update(
        details=" ".join(_sensed_notes(spec)),
        model=spec.observation.model_dump(mode="json"),
    )
    known["actions"] = _of_actions(spec)
    known["rewards"] = _of_rewards(task)
    known["reward_terms"] = _of_reward_terms(task)
    known.setdefault("episodes/layouts", {})["shapes"] = list(SHAPE_MEANINGS)
    known.setdefault("events", {})["separation"] = {"value": SEPARATION_GAP, "unit": "m"}
    for name in shapes:
        if ALL_FIELDS[name].rows != "episodes":
            known.setdefault(name, {})["step"] = {"value": spec.control_dt, "unit": "s"}
    return known


def _sensed_notes(spec: TaskSpec) -> Iterator[str]:
    """How the observations of a task are laid out, and what the numbers of their model mean."""
    model, drawn = spec.observation, spec.randomization.noise
    is_turned = model.kind == "state" and model.in_body_frame
    yield BODY_STATE_NOTE if is_turned else SENSED_NOTES[model.kind]
    yield MODIFIED_NOTE
    if model.drift != Drift():
        yield DRIFT_NOTE
    if drawn is not None:
        span = f"{drawn[0]:g} to {drawn[1]:g}"
        yield f"Instead of `noise`, an episode draws one deviation for each robot, from {span}."


def _of_actions(spec: TaskSpec) -> Attributes:
    """Commands, once for all robots or, where they differ, for each."""
    each = [action_columns(robot, spec) for robot in spec.robots]
    if all(columns == each[0] for columns in each):
        return _of_columns(each[0])
    by_agent = zip(spec.agent_names, map(_plain, each), strict=True)
    return {"columns_of_agents": dict(by_agent), "frames": FRAME_MEANINGS}


def _of_columns(columns: Sequence[Column]) -> Attributes:
    """Columns, and the frames that they name."""
    used = {column.frame for column in columns}
    frames = {name: meaning for name, meaning in FRAME_MEANINGS.items() if name in used}
    return {"columns": _plain(columns), **({"frames": frames} if frames else {})}


def _of_rewards(task: Task) -> Attributes:
    return {
        "details": REWARD_FORMULA + sides_note(task.spec),
        "terms": [term._asdict() | {"formula": term.formula} for term in reward_terms(task)],
        "team_share": task.spec.rules.rewards.team_share,
        "precision": PRECISION_NOTE,
    }


def _of_reward_terms(task: Task) -> Attributes:
    """Columns with their weights and signs, so that rewards can be computed from this array."""
    return {
        "details": TERMS_FORMULA + sides_note(task.spec),
        "columns": [
            column | {"value": term.value, "weight": term.weight, "sign": term.sign}
            for column, term in zip(_plain(term_columns(task)), reward_terms(task), strict=True)
        ],
        "team_share": task.spec.rules.rewards.team_share,
    }


def _of_recording(spec: Spec, shapes: Shapes) -> dict[str, Attributes]:
    """What the interface of another environment tells."""
    spaces = {
        "observations": spec.observation_spaces(shapes.get("observations", (0,))[-1]),
        "actions": spec.action_spaces,
    }
    return {
        "states": {"details": spec.state_meaning},
        **{
            name: {
                "details": RECORDED_LAYOUT,
                "spaces": {
                    agent: {"columns": width(space), "space": space.model_dump(mode="json")}
                    for agent, space in zip(spec.agent_names, of_agents, strict=True)
                },
            }
            for name, of_agents in spaces.items()
        },
    }


def _range(described: Column | Field) -> list[float | None]:
    return [None if bound is None else float(bound) for bound in (described.low, described.high)]


def _plain(columns: Sequence[Column]) -> list[Attributes]:
    """Columns as JSON."""
    return [
        {"name": c.name, "meaning": c.meaning, "unit": c.unit, "range": _range(c), "frame": c.frame}
        for c in columns
    ]
