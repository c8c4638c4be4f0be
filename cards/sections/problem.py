"""The sections of a card that describe the problem, the reward and the arrays."""

import inspect
import re
import sys

from swarmdata.drawing.markdown import plain, table
from swarmdata.errors import SchemaError, SpecError
from swarmdata.interfaces import Task
from swarmdata.perception.observer import Observer
from swarmdata.perception.wayfinder import ways_definition
from swarmdata.registry.components import reward_terms
from swarmdata.specs.features import UNITS
from swarmdata.specs.frozen import Frozen
from swarmdata.specs.state_layout import N_COLUMNS, ROBOT, state_size
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.store import Manifest
from swarmdata.store.arrays.attributes import (
    FRAME_MEANINGS,
    PRECISION_NOTE,
    REWARD_FORMULA,
    sides_note,
)
from swarmdata.store.arrays.column_meanings import state_columns
from swarmdata.types import EVENT_COLUMNS

SETTINGS = ("setting", "value")  # header of the tables that list a spec


def task_section(task: Task) -> str:
    """The problem: robots, arena, rules."""
    spec = task.spec
    goes_on = spec.on_collision == "continue"
    rows = [
        ("robots", ", ".join(f"{role.count} x {role.name}" for role in spec.team)),
        ("arena", f"{spec.arena.width:g} m x {spec.arena.height:g} m"),
        ("horizon", f"{spec.horizon} steps = {spec.horizon * spec.control_dt:g} s"),
        ("control step", f"{spec.control_dt:g} s, simulated in {spec.n_substeps} physics steps"),
        ("after a collision", f"the episode {'continues' if goes_on else 'fails'}"),
    ]
    for role in spec.team:
        robot = role.robot
        text = (
            f"{robot.dynamics}, {robot.command} commands, radius {robot.radius:g} m, at most "
            f"{robot.max_speed:g} m/s and {robot.acceleration:g} m/s²"
        )
        rows.append((role.name, text))
    rows += [row for row in _settings("", spec.rules) if row[0] != "task"]
    rows += _settings("obstacles: ", spec.obstacles)
    rows += [
        (f"drawn in each episode: {name.replace('_', ' ')}", plain(span))
        for name, span in spec.randomization.ranges.items()
    ]
    return "\n## Task\n\n" + table(SETTINGS, rows) + _task_notes(task)


def _settings(prefix: str, model: Frozen) -> list[tuple[str, str]]:
    """One row for each written value of a part of the spec; nested ones are named by their path."""
    rows = []
    for name in model.model_dump():
        value, path = getattr(model, name), f"{prefix}{name.replace('_', ' ')}"
        is_nested = isinstance(value, Frozen)
        rows += _settings(f"{path}: ", value) if is_nested else [(path, plain(value))]
    return rows


def _task_notes(task: Task) -> str:
    rules = inspect.getdoc(sys.modules[type(task).__module__]) or ""
    spec = task.spec
    return (
        "\nLengths are in m, times in s, masses in kg and angles in rad.\n"
        f"\nThe rules, as documented in the code of the task:\n\n```text\n{rules}\n```\n"
        "\nEach robot has a reward of its own. The team return of an episode is the sum over time "
        "of the mean reward over robots. An episode terminates on success"
        f"{' or on a collision' if spec.on_collision == 'fail' else ''} and is truncated at the "
        "horizon.\n"
    )


def senses_section(spec: TaskSpec) -> str:
    """What robots sensed and received."""
    rows = _settings("observation: ", spec.observation)
    rows += _settings("communication: ", spec.communication)
    rows.sort(key=lambda row: (not row[0].startswith("observation"), not row[0].endswith("kind")))
    return (
        "\n## Observations and communication\n\n"
        "The stored observations follow the models below. Learned policies acted on them; scripted "
        "controllers may read the states. `Dataset.reobserve` computes the observations of other "
        "models from the recorded states; the actions stay the same.\n\n" + table(SETTINGS, rows)
    )


ROW_OFFSETS = (
    "Arrays with one row per step (actions, rewards, events, ...) hold episode e in rows "
    "`starts[e]` to `starts[e] + lengths[e] - 1`. Arrays with one row per state (observations, "
    "states, sent, delivered, ages) have one more row in each episode and hold episode e in rows "
    "`starts[e] + e` to `starts[e] + e + lengths[e]`. The Zarr attributes of each array describe "
    "its rows and columns, with units, ranges and frames."
)


FieldRow = tuple[str, str, str, str]  # columns, name, unit and meaning


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
        rows.append((_columns(where), f"`{name}`", UNITS.get(first.kind, ""), first.meaning))
    return rows


def _columns(columns: list[int]) -> str:
    """Column numbers; if there are many, the first two and the last: `8, 12, … 68`."""
    if len(columns) <= 4:
        return ", ".join(map(str, columns))
    return f"{columns[0]}, {columns[1]}, … {columns[-1]}"


def state_rows(task: Task) -> list[FieldRow]:
    """The columns of the state."""
    columns, first = state_columns(task), N_COLUMNS * task.spec.n_agents
    robots = [
        (f"{N_COLUMNS} i + {k}", f"`robot i: {name}`", column.unit, column.meaning)
        for k, (name, column) in enumerate(zip(ROBOT, columns, strict=False))
    ]
    return robots + [
        (str(k), f"`{column.name}`", column.unit, column.meaning)
        for k, column in enumerate(columns[first:], start=first)
    ]


def arrays_table(manifest: Manifest) -> str:
    """The stored arrays with their shapes."""
    rows = [
        (f"`{name}`", entry.dtype, " x ".join(map(str, entry.shape)))
        for name, entry in sorted(manifest.arrays.items())
    ]
    return f"\n## Arrays\n\n{table(('array', 'dtype', 'shape'), rows)}\n{ROW_OFFSETS}\n\n"


def arrays_section(task: Task, manifest: Manifest) -> str:
    """The stored arrays, column by column.

    Raises:
        SchemaError: the arrays have other widths than the description.
        SpecError: a feature has no description.
    """
    spec, rows, arrays = task.spec, observation_rows(task), manifest.arrays
    size = state_size(spec.n_agents, len(task.movables), len(task.extras))
    for what, got, expected in (
        ("observation", arrays["observations"].shape[2], len(Observer(task, 1).features)),
        ("state", arrays["states"].shape[1], size),
    ):
        if got != expected:
            raise SchemaError(
                f"{what} features: the arrays have {got}, the description has {expected}"
            )
    head = ("column", "name", "unit", "meaning")
    return (
        arrays_table(manifest) + "Actions are commands in [-1, 1], in units of the robot's limit. "
        "`log_probs` are the log-probabilities of the robots' actions under the policy that chose "
        "them, summed over components: the log-density of the action noise inside (-1, 1), and at "
        "a bound the logarithm of the probability of being clipped to it. They are 0 without "
        "noise.\n"
        + "\n### Observation of one robot\n\n"
        + table(head, rows)
        + "\n### State\n\n"
        + table(head, state_rows(task))
        + f"\nRobots i = 0, 1, ...: {', '.join(spec.agent_names)}. All vectors are in the world "
        f"frame: {FRAME_MEANINGS['world']}.\n"
    )


def definitions_section(task: Task) -> str:
    """What the names of columns, terms and metrics stand for where a line is too short, if any."""
    definitions = dict(getattr(task, "definitions", {}))
    if task.spec.observation.ways:
        definitions["_way"] = ways_definition(task.spec)
    if not definitions:
        return ""
    rows = [(f"`{name}`", meaning) for name, meaning in definitions.items()]
    return "\n### Definitions\n\n" + table(("name", "definition"), rows)


SINGLE_ROBOT_NOTE = (
    "Each robot has a target of its own, and team_share is 0. So its reward depends on the others "
    "only through contacts and proximity, and through the end of the episode, when success is "
    "rewarded."
)

STORED_NOTE = (
    "The values of the terms, without weights and signs, are stored as `reward_terms` [T, N, R] in "
    "this order: `dataset[0].reward_terms`. Rewards with other weights are a view: "
    "`dataset.with_rewards(robot_collision=2.0)`."
)


def reward_section(task: Task) -> str:
    """Every term of a robot's reward with its numbers, and the events it is computed from."""
    terms = [
        (term.name, f"{term.weight:g}", f"`{term.formula}`", term.meaning)
        for term in reward_terms(task)
    ]
    events = [(f"`{column.name}`", column.meaning) for column in EVENT_COLUMNS]
    share = task.spec.rules.rewards.team_share
    counting = (
        "Gaps are distances between surfaces. `episodes/robot_collisions` counts a pair of robots "
        "once, `events` in the rows of both. `episodes/obstacle_collisions` is the sum over robots."
    )
    if task.spec.rules.has_own_targets and not share:
        counting = f"{SINGLE_ROBOT_NOTE}\n\n{counting}"
    if task.movables:
        counting += " Contacts with the payload are not in `events`."
    if task.spec.on_collision == "fail":
        counting += (
            " A contact that begins fails the episode. If the task is solved in the same step, its "
            "success is rewarded, but the episode counts as failed."
        )
    return (
        "\n## Reward\n\n"
        + table(("term", "weight", "formula", "where"), terms)
        + f"\n{REWARD_FORMULA}{sides_note(task.spec)} Here team_share is {share:g}. {STORED_NOTE} "
        + f"{PRECISION_NOTE}\n\n"
        + table(("column of `events`", "meaning"), events)
        + f"\n{counting}\n"
    )
