"""Pages of tasks and presets: what they are, their arrays column by column, and their datasets."""

from collections.abc import Iterable, Sequence
from importlib import import_module

from docs.site.docstrings import field_notes, markdown_of
from swarmdata.cards.worlds_page import preset_figures
from swarmdata.drawing.markdown import plain, table
from swarmdata.registry.components import TASKS, make_task, reward_terms
from swarmdata.registry.presets import preset, preset_names, preset_summary
from swarmdata.registry.published import published, references
from swarmdata.registry.recipes import shipped_recipes
from swarmdata.rollouts.metrics import metrics_of
from swarmdata.store.arrays.column_meanings import (
    action_columns,
    observation_columns,
    state_columns,
)
from swarmdata.types import EVENT_COLUMNS, Column

COLUMN_HEAD = ("column", "name", "meaning", "unit", "range", "frame")


def task_pages() -> dict[str, str]:
    """A page for each task and each preset, and their indexes."""
    pages = {f"reference/tasks/{name}.md": task_page(name) for name in TASKS}
    pages |= {f"reference/presets/{name}.md": preset_page(name) for name in preset_names()}
    tasks = [
        [f"[`{name}`]({name}.md)", make_task(preset(name)).solved, str(len(presets_of(name)))]
        for name in TASKS
    ]
    pages["reference/tasks/index.md"] = (
        "# Tasks, one by one\n\nRules, rewards, metrics and the arrays of each task. [The guide]"
        f"(../../docs/tasks.md) says how to choose one.\n\n"
        f"{table(('task', 'solved when', 'presets'), tasks)}"
    )
    pages["reference/presets/index.md"] = (
        "# Presets, one by one\n\nA preset is a named task: `swarmdata.preset(NAME)`, or "
        f"`--task NAME` on the command line.\n\n{_preset_table(preset_names())}"
    )
    return pages


def presets_of(task: str) -> list[str]:
    """Names of the presets of a task."""
    return [name for name in preset_names() if preset(name).task == task]


def task_page(name: str) -> str:
    """The page of a task."""
    spec = preset(name)
    task = make_task(spec)
    module = import_module(TASKS[name].partition(":")[0])
    notes = field_notes(type(spec.rules.rewards))
    terms = [
        [f"`{term.name}`", plain(term.weight), "+" if term.sign > 0 else "-", f"`{term.value}`",
         term.meaning, notes.get(term.name, "")]
        for term in reward_terms(task)
    ]  # fmt: skip
    observed = observation_columns(task)
    metrics = [
        [f"`{key}`", each.label, each.unit, each.better, each.meaning]
        for key, each in metrics_of(name).items()
    ]
    return f"""# Task `{name}`

<img src="../../cards/worlds/{name}-scripted.gif" width="240" alt="a scripted team in {name}">

An episode is solved when {task.solved}. Fields of the rules are in [the schema of task
files](../schemas/task.md#{type(spec.rules).__name__.lower()}); the figures below are of the preset
[`{name}`](../presets/{name}.md).

## Definition

{markdown_of(module.__doc__ or "")}
## Rewards

A robot's reward in a step is the sum of sign x weight x value over these terms. `reward_terms`
holds the values, [T, N, R], in this order.

{table(("term", "weight", "sign", "value", "symbols", "counts"), terms)}
## Metrics of an episode

{table(("metric", "label", "unit", "better", "meaning"), metrics)}
## Presets

{_preset_table(presets_of(name))}
## Observations

One robot's row of `observations` [T+1, N, {len(observed)}], sensed as the preset says
(`{spec.observation.kind}`). [Other sensors and radios](../layouts/index.md) have other columns.

{columns_table(observed)}
## States

A row of `states` [T+1, {len(state_columns(task))}]. Every robot has the columns of the first.

{columns_table(state_columns(task), tuple(f"{name}." for name in spec.agent_names[1:]))}
## Actions

One robot's row of `actions` [T, N, {spec.action_size}].

{columns_table(action_columns(spec.robots[0], spec))}
## Events

One robot's row of `events` [T, N, {len(EVENT_COLUMNS)}].

{columns_table(tuple(EVENT_COLUMNS))}"""


def preset_page(name: str) -> str:
    """The page of a preset."""
    spec = preset(name)
    task = make_task(spec)
    datasets = [
        [f"[`{key}`](../../cards/published/{key}.md)", recipe.tier, f"{published()[key].n_steps:,}",
         percent(published()[key].success)]
        for key, recipe in sorted(shipped_recipes().items())
        if recipe.spec == spec and key in published()
    ]  # fmt: skip
    found = table(("dataset", "tier", "joint steps", "success"), datasets) if datasets else (
        "No dataset of this preset is published. `swarmdata generate --task "
        f"{name}` [makes one](../../docs/generating.md).\n"
    )  # fmt: skip
    return f"""# Preset `{name}`

{preset_summary(name) or "A preset."} It is of the task [`{spec.task}`](../tasks/{spec.task}.md).

```python
import swarmdata

env = swarmdata.make_env(swarmdata.preset("{name}"), n_copies=64)
```

One robot observes {len(observation_columns(task))} numbers and commands {spec.action_size};
a state has {len(state_columns(task))}. An episode has at most {spec.horizon} steps of
{spec.control_dt:g} s.

## Reference policies

{preset_figures(name, references())}
## Datasets

{found}
## The whole spec

`swarmdata task show {name}` prints it; [the schema](../schemas/task.md) explains the fields.

```yaml
{spec.to_yaml()}```
"""


def columns_table(columns: Sequence[Column], hidden: tuple[str, ...] = ()) -> str:
    """Columns of an array, without those whose names begin with `hidden`."""
    rows = [
        [str(place), f"`{column.name}`", column.meaning, column.unit, _bounds(column), column.frame]
        for place, column in enumerate(columns)
        if not column.name.startswith(hidden)
    ]
    return table(COLUMN_HEAD, rows)


def percent(share: float) -> str:
    """A share as the tables write it."""
    return f"{100 * share:.1f} %"


def _bounds(column: Column) -> str:
    if column.low is None and column.high is None:
        return ""
    low, high = ("" if each is None else f"{each:g}" for each in (column.low, column.high))
    return f"[{low}, {high}]"


def _preset_table(names: Iterable[str]) -> str:
    rows = []
    for name in names:
        spec = preset(name)
        robots = ", ".join(f"{role.count} {role.robot.dynamics}" for role in spec.team)
        arena = f"{spec.arena.width:g} x {spec.arena.height:g}"
        rows.append([
            f"[`{name}`](../presets/{name}.md)", spec.task, robots, arena,
            f"{spec.horizon * spec.control_dt:g}", preset_summary(name),
        ])  # fmt: skip
    return table(("preset", "task", "robots", "arena (m)", "time (s)", "what it is"), rows)
