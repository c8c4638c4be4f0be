"""The pages of all worlds: how reference policies perform in every preset."""

from collections.abc import Mapping, Sequence

from swarmdata.cards.references import LESS_COORDINATED, gap_section
from swarmdata.drawing.markdown import table
from swarmdata.registry.presets import preset, preset_names
from swarmdata.registry.published import Interval, TaskReferences
from swarmdata.rollouts.metrics import EPISODE_METRICS, SOLVED_TIME, metrics_of
from swarmdata.specs.rules import rules_model

SHARED_METRICS = ("return", "success", "clean_success", "robot_collisions", "obstacle_collisions")
"""Metrics that every row has; those of the task follow."""

INDEX_HEAD = """# Worlds

Percentages of episodes that teams solve in every preset, in brackets those solved without any
contact, over {n} reserved evaluation seeds. A preset's name leads to its whole table.
`swarmdata references PRESET --out cards/references.json`
measures a preset again, and `swarmdata task table --out docs/worlds` writes these pages.

Where policies were trained for a preset, `medium` and `expert` are means over their checkpoints,
which act greedily, without noise. Where a team needs a convention, `expert` is the mean over the
scripted teams that follow one, in the order of the [tiers](../tiers.md#conventions).
"""

TASK_HEAD = """# Worlds of {task}

The performance of reference teams in every preset of `{task}`: idle, random, driving straight to
the targets, scripted and, where they were trained, medium and expert, with a row for each
checkpoint. Values are means over reserved evaluation seeds, with 95 % bootstrap intervals of return
and success; times are those of solved episodes. The score is 0 for the better of the idle and the
random team and 100 for the expert. The [index](README.md) says how to measure them again.
"""

POLICY_ORDER = ("idle", "random", "straight", *LESS_COORDINATED, "scripted", "medium", "expert")
"""Rows of a table."""

INDEX_POLICIES = ("straight", *LESS_COORDINATED, "scripted", "medium", "expert")
"""Columns of the index, behind the naive teams of the task."""


def worlds_pages(known: Mapping[str, TaskReferences]) -> dict[str, str]:
    """Returns the pages as Markdown, by file name: an index, and the presets of each task.

    Args:
        known: measured references by preset; presets without an entry are named as not measured.
    """
    tasks: dict[str, list[str]] = {}
    for name in preset_names():
        tasks.setdefault(preset(name).task, []).append(name)
    n_episodes = sorted({entry.n_episodes for entry in known.values()})
    index = INDEX_HEAD.format(n=" or ".join(f"{n:,}" for n in n_episodes))
    pages = {}
    for task, names in tasks.items():
        teams = (*rules_model(task).naive_teams, *INDEX_POLICIES)
        rows = [
            [f"[`{name}`]({task}.md#{name})", *_success(known.get(name), teams)] for name in names
        ]
        index += f"\n## {task}\n\n{table(['preset', *teams], rows, is_numeric=True)}"
        sections = (f"\n## `{name}`\n\n{preset_figures(name, known.get(name))}" for name in names)
        pages[f"{task}.md"] = TASK_HEAD.format(task=task) + "".join(sections)
    return {"README.md": index, **pages}


def _success(entry: TaskReferences | None, teams: Sequence[str]) -> list[str]:
    """The shares of episodes that teams solve, and solve cleanly, in %."""
    shares = []
    for policy in teams:
        figures = entry.policies.get(policy, {}) if entry else {}
        measured = [figures.get(metric) for metric in ("success", "clean_success")]
        solved, clean = (each and f"{100 * each.value:.1f}" for each in measured)
        shares.append(f"{solved} ({clean})" if solved else "")
    return shares


def preset_figures(name: str, entry: TaskReferences | None) -> str:
    """Returns a preset in one line and the table of its reference policies, as Markdown.

    Args:
        name: of the preset.
        entry: its measured references; None: they were not measured.
    """
    spec = preset(name)
    robots = ", ".join(f"{role.count} x {role.name}" for role in spec.team)
    share = spec.rules.rewards.team_share
    shared = f" The team's mean is {share:.0%} of each robot's reward." if share else ""
    head = (
        f"{robots}; {spec.arena.width:g} m x {spec.arena.height:g} m; "
        f"{spec.horizon * spec.control_dt:g} s.{shared}\n\n"
    )
    if entry is None or entry.spec_hash != spec.hash():
        return f"{head}This version of the preset was not measured.\n"
    metrics = metrics_of(spec.task)
    own = [metric for metric in metrics if metric not in EPISODE_METRICS]
    columns = [*SHARED_METRICS, "time_to_goal", *own]
    labels = [SOLVED_TIME if c == "time_to_goal" else metrics[c].label for c in columns]
    units = [metrics[column].unit for column in columns]
    titles = [f"{k} ({unit})" if unit else k for k, unit in zip(labels, units, strict=True)]
    rows = []
    for policy, values in sorted(entry.policies.items(), key=lambda item: _rank(item[0])):
        team_return = entry.mean_return(policy)
        score = None if team_return is None else entry.score(team_return)
        shown = "no expert" if score is None else f"{score:.1f}"
        rows.append([policy, shown, *(_cell(values.get(column), column) for column in columns)])
    return (
        head
        + table(["policy", "score", *titles], rows)
        + gap_section(entry, spec.rules.naive_teams)
    )


def _rank(policy: str) -> tuple[int, str]:
    """Sorts policies as in `POLICY_ORDER`, the checkpoints of a tier after it."""
    tier = policy.rstrip("0123456789").removesuffix("-")
    return POLICY_ORDER.index(tier) if tier in POLICY_ORDER else len(POLICY_ORDER), policy


def _cell(value: Interval | None, column: str) -> str:
    if value is None:
        return "never"
    if column in ("success", "clean_success"):
        shown = [f"{100 * v:.1f}" for v in (value.value, value.low, value.high)]
        return f"{shown[0]} %" if column != "success" else _with_interval(shown, " %")
    shown = [f"{v:.2f}" for v in (value.value, value.low, value.high)]
    return _with_interval(shown, "") if column == "return" else shown[0]


def _with_interval(shown: Sequence[str], unit: str) -> str:
    return f"{shown[0]} [{shown[1]}, {shown[2]}]{unit}"
