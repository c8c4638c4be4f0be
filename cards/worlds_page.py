"""The page of all worlds: how reference policies perform in every preset."""

from collections.abc import Mapping, Sequence

from swarmdata.drawing.markdown import table
from swarmdata.registry.presets import preset, preset_names
from swarmdata.registry.published import Interval, TaskReferences
from swarmdata.rollouts.metrics import EPISODE_METRICS, metrics_of

SHARED_METRICS = ("return", "success", "clean_success", "robot_collisions", "obstacle_collisions")
"""Metrics that every row has; those of the task follow."""

PAGE_HEAD = """# Worlds

The performance of four teams in every preset: idle, random, driving straight to the targets, and
scripted. Values are means over {n} reserved evaluation seeds, with 95 % bootstrap intervals of
return and success; times are those of solved episodes. `swarmdata references PRESET --out
cards/references.json` measures a preset again, and `swarmdata task table --out docs/worlds.md`
writes this page.

Where policies were trained for a preset, `medium` and `expert` are means over their checkpoints,
and a row for each checkpoint follows; these policies act greedily, without noise. Where a team
needs a convention, `expert` is the mean over the scripted teams that follow one, in the order of
`docs/tiers.md`. The score is 0 for the better of the idle and the random team and 100 for the
expert.
"""


POLICY_ORDER = ("idle", "random", "straight", "scripted", "medium", "expert")
"""Rows of a table."""


def worlds_page(known: Mapping[str, TaskReferences]) -> str:
    """Returns the page as Markdown: a section for each task, a table for each preset.

    Args:
        known: measured references by preset; presets without an entry are named as not measured.
    """
    tasks: dict[str, list[str]] = {}
    for name in preset_names():
        tasks.setdefault(preset(name).task, []).append(name)
    n_episodes = sorted({entry.n_episodes for entry in known.values()})
    text = PAGE_HEAD.format(n=" or ".join(f"{n:,}" for n in n_episodes))
    for task, names in tasks.items():
        text += f"\n## {task}\n"
        for name in names:
            text += _preset(name, known.get(name))
    return text


def _preset(name: str, entry: TaskReferences | None) -> str:
    spec = preset(name)
    robots = ", ".join(f"{role.count} x {role.name}" for role in spec.team)
    share = spec.rules.rewards.team_share
    shared = f" The team's mean is {share:.0%} of each robot's reward." if share else ""
    head = (
        f"\n### `{name}`\n\n{robots}; {spec.arena.width:g} m x {spec.arena.height:g} m; "
        f"{spec.horizon * spec.control_dt:g} s.{shared}\n\n"
    )
    if entry is None or entry.spec_hash != spec.hash():
        return f"{head}This version of the preset was not measured.\n"
    metrics = metrics_of(spec.task)
    own = [metric for metric in metrics if metric not in EPISODE_METRICS]
    columns = [*SHARED_METRICS, "time_to_goal", *own]
    shown_metrics = [metrics[column] for column in columns]
    titles = [f"{each.label} ({each.unit})" if each.unit else each.label for each in shown_metrics]
    rows = []
    for policy, values in sorted(entry.policies.items(), key=lambda item: _rank(item[0])):
        team_return = entry.mean_return(policy)
        score = None if team_return is None else entry.score(team_return)
        shown = "no expert" if score is None else f"{score:.1f}"
        rows.append([policy, shown, *(_cell(values.get(column), column) for column in columns)])
    return head + table(["policy", "score", *titles], rows)


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
