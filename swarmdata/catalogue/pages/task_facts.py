"""What a page says of a task: two sentences, the terms of the reward, the arrays with columns."""

import inspect
import re
import sys
from collections.abc import Sequence

from swarmdata.catalogue.elements import Html, element, join, section, table
from swarmdata.catalogue.entries import Entry
from swarmdata.catalogue.pages.figures_shown import count
from swarmdata.datasets.dataset import Dataset
from swarmdata.interfaces import Task
from swarmdata.registry.components import make_task, reward_terms
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.store.arrays.column_meanings import columns_of
from swarmdata.store.arrays.layout import ALL_FIELDS
from swarmdata.types import EVENTS, Column

COLUMN_ARRAYS = ("observations", "states", "actions", "events", "sent")
"""Arrays whose columns have names, in the order of the page, without the terms of the reward."""

_INDEX = re.compile(r"_\d+$")


def lead(entry: Entry) -> str:
    """The task in two sentences: what the team does, and when it is done."""
    spec = entry.spec.world
    if spec is None:
        where = "logs of robots" if entry.kind == "robot logs" else "another environment"
        who = count(entry.spec.n_agents, "agent")
        text = f"Episodes of {who} in {entry.spec.task}, from {where}."
        stated = {} if entry.dataset is None else entry.dataset.recipe.metadata or {}
        return f"{text} {stated['description']}" if "description" in stated else text
    task = make_task(spec)
    doc = inspect.getdoc(sys.modules[type(task).__module__]) or ""
    first = " ".join(doc.partition("\n\n")[0].split()).rstrip(".")
    n = spec.n_agents
    what = re.sub(r"\bN - 1\b", str(n - 1), first.partition(": ")[2] or first)
    what = re.sub(r"\bN robots\b", f"{n} robots", what)
    solved = re.sub(r"`(\w+)`", r"\1", task.solved)
    arena = f"{spec.arena.width:g} m × {spec.arena.height:g} m"
    return (
        f"{what[:1].upper()}{what[1:]}, in an arena of {arena}. An episode is solved when "
        f"{solved}, within {spec.horizon} steps ({spec.horizon * spec.control_dt:g} s)."
    )


def reward_part(spec: TaskSpec) -> Html:
    """The terms of a robot's reward with their weights."""
    rows: list[tuple[object, ...]] = []
    for term in reward_terms(make_task(spec)):
        what: list[object] = [element("code", term.value)]
        if term.value not in EVENTS:  # which the table of arrays names
            what.append(element("small", term.meaning))
        rows.append((term.name, f"{term.signed_weight:+g}", join(*what)))
    share = spec.rules.rewards.team_share
    note = (
        "The team return is the sum over time of the mean over robots. Terms are stored without "
        "their weights: "
    )
    if share:
        whose = "team" if len(spec.sides) == 1 else "side"
        note = (
            f"A robot gets {1 - share:g} of its own sum and {share:g} of its {whose}'s mean. {note}"
        )
    code = element("code", "dataset.with_rewards(robot_collision=2.0)")
    terms = table(("term", "weight", "each step"), rows, class_="terms")
    return section("Reward of a robot", "reward", terms, element("p", note, code, class_="note"))


def arrays_part(entry: Entry) -> Html:
    """The arrays of an episode with their shapes and the names of their columns."""
    spec = entry.spec.world
    rows = [] if spec is None else _world_rows(make_task(spec))
    if entry.dataset is not None:
        stored = _recorded_rows(entry.dataset)
        names = {name for name, *_ in stored}
        rows = stored if spec is None else [row for row in rows if row[0] in names]
    shown: list[tuple[object, ...]] = [(element("code", name), *rest) for name, *rest in rows]
    agents = "robots" if spec is not None else "agents"
    text = element("p", f"T steps, {entry.spec.n_agents} {agents}.", class_="note")
    arrays = table(("array", "shape", "columns"), shown, class_="arrays")
    return section("Arrays of an episode", "arrays", text, arrays)


def _world_rows(task: Task) -> list[tuple[str, str, str]]:
    n, found = task.spec.n_agents, []
    for name in COLUMN_ARRAYS:
        columns = columns_of(task, name)
        steps = "T" if name in ("actions", "events") else "T+1"
        shape = f"{steps}, {len(columns)}" if name == "states" else f"{steps}, {n}, {len(columns)}"
        if columns:
            found.append((name, shape, column_names(columns)))
    terms = reward_terms(task)
    found += [
        ("rewards", f"T, {n}", "of each robot"),
        ("reward_terms", f"T, {n}, {len(terms)}", "the terms of the reward, in their order"),
        ("log_probs", f"T, {n}", "of the actions under the policy that chose them"),
    ]
    return found


def column_names(columns: Sequence[Column]) -> str:
    """The names of columns, those of numbered slots once: `3 × neighbor: dx, dy`."""
    slots: dict[str, set[str]] = {}
    leaves: dict[str, dict[str, None]] = {}  # in their order
    for column in columns:
        slot, _, leaf = column.name.rpartition(".")
        kind = _INDEX.sub("", slot)
        slots.setdefault(kind, set()).add(slot)
        leaves.setdefault(kind, {})[_INDEX.sub("_*", leaf)] = None
    parts = []
    for kind, names in leaves.items():
        count = f"{len(slots[kind])} × " if len(slots[kind]) > 1 else ""
        parts.append(f"{count}{kind}: {', '.join(names)}" if kind else ", ".join(names))
    return "; ".join(parts)


def _recorded_rows(dataset: Dataset) -> list[tuple[str, str, str]]:
    rows = []
    for name, array in dataset.stored.manifest.arrays.items():
        kind = ALL_FIELDS[name].rows
        if kind != "episodes" and 0 not in array.shape:
            steps = "T" if kind == "steps" else "T+1"
            rows.append((name, ", ".join([steps, *map(str, array.shape[1:])]), "as recorded"))
    return rows
