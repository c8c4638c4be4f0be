"""The pages of all worlds: how reference policies perform in the presets."""

from collections.abc import Collection, Mapping, Sequence

from swarmdata.cards.references import LESS_COORDINATED, gap_section
from swarmdata.drawing.markdown import table
from swarmdata.registry.presets import preset, preset_names
from swarmdata.registry.published import REFERENCE_OPPONENTS, TaskReferences, side_specs
from swarmdata.specs.rules import rules_model

FIGURES = (
    "return", "success (%)", "clean success (%)", "robot collisions", "obstacle collisions"
)  # fmt: skip
"""Columns after the policy and its score."""

INDEX_HEAD = """# Worlds

How many of {n} reserved episodes reference teams solve in the presets, in per cent, and in
brackets how many without any contact. `straight` drives straight to its target, `scripted` knows
the map; it is `-alone` as if there were no others, `-naive` as if others were parked, and `-deaf`
without messages ([why](../coordination.md)). Other columns are teams that do not act together.
`medium` and `expert` are the means of the learned policies of a [tier](../tiers.md), without
action noise; in presets that need a convention, `expert` is the mean of the two scripted teams.
[references.json](../../cards/references.json) has every checkpoint, metric and interval.
"""

TASK_HEAD = """# Worlds of {task}

How reference teams perform in the presets of `{task}`, on the [reserved
episodes](../glossary.md#results). Collisions are means per episode. The second table is the
[coordination gap](../coordination.md): by how many points the scripted team is better than the same
controllers with less coordination, with 95 % bootstrap intervals over the same episodes.

{teams}"""

POLICY_ORDER = ("idle", "random", "straight", "scripted", "medium", "expert")
"""Rows of a table; the gaps of teams that coordinate less are below it."""

INDEX_POLICIES = ("straight", *LESS_COORDINATED, "scripted", "medium", "expert")
"""Columns of the index, behind the naive teams of the task."""


def worlds_pages(known: Mapping[str, TaskReferences]) -> dict[str, str]:
    """Returns the pages as Markdown, by file name: an index, and the presets of each task.

    Presets without an entry in `known` are named as not measured.
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
            [f"[`{name}`]({task}.md#{name}){side and f', {side}'}", *_success(entry, teams)]
            for name in names
            for side, entry in _tables(name, known).items()
        ]
        index += f"\n## {task}\n\n{table(['preset', *teams], rows, is_numeric=True)}"
        sections = (f"\n## `{name}`\n\n{preset_figures(name, known)}" for name in names)
        meanings = {**LESS_COORDINATED, **rules_model(task).naive_teams}
        listed = "".join(f"- `{name}`: {meaning}\n" for name, meaning in meanings.items())
        pages[f"{task}.md"] = TASK_HEAD.format(task=task, teams=listed) + "".join(sections)
    return {"README.md": index, **pages}


def _tables(name: str, known: Mapping[str, TaskReferences]) -> dict[str, TaskReferences | None]:
    """The references of a preset, or of each of its sides by its name; None: not measured."""
    spec = preset(name)
    sides = {side: (f"{name}-{side}", each.hash()) for side, each in side_specs(spec).items()}
    wanted = sides or {"": (name, spec.hash())}
    found = {side: (known.get(key), spec_hash) for side, (key, spec_hash) in wanted.items()}
    return {
        side: entry if entry is not None and entry.spec_hash == spec_hash else None
        for side, (entry, spec_hash) in found.items()
    }


def _success(entry: TaskReferences | None, teams: Sequence[str]) -> list[str]:
    """The shares of episodes that teams solve, and solve cleanly, in %."""
    shares = []
    for policy in teams:
        figures = entry.policies.get(policy, {}) if entry else {}
        measured = [figures.get(metric) for metric in ("success", "clean_success")]
        solved, clean = (each and f"{100 * each.value:.1f}" for each in measured)
        shares.append(f"{solved} ({clean})" if solved else "")
    return shares


def preset_figures(name: str, known: Mapping[str, TaskReferences]) -> str:
    """Returns a preset in one line and the tables of its reference policies in `known`, Markdown.

    In a preset of several sides, each has a table.
    """
    spec = preset(name)
    robots = ", ".join(f"{role.count} x {role.name}" for role in spec.team)
    share = spec.rules.rewards.team_share
    shared = f" The team's mean is {share:.0%} of each robot's reward." if share else ""
    head = (
        f"{robots}; {spec.arena.width:g} m x {spec.arena.height:g} m; "
        f"{spec.horizon * spec.control_dt:g} s.{shared}\n\n"
    )
    tables = (
        f"{side and f'The {side}, against the {REFERENCE_OPPONENTS} others:'}\n\n"
        f"{_figures(entry, spec.rules.naive_teams)}"
        for side, entry in _tables(name, known).items()
    )
    return head + "\n".join(tables).lstrip()


def _figures(entry: TaskReferences | None, naive_teams: Collection[str]) -> str:
    """The table of reference policies and that of gaps."""
    if entry is None:
        return "This version of the preset was not measured.\n"
    score = [] if entry.reference is None else ["score"]
    rows = [_row(policy, entry) for policy in POLICY_ORDER if policy in entry.policies]
    figures = table(["policy", *score, *FIGURES], rows, is_numeric=True)
    return figures + gap_section(entry, naive_teams)


def _row(policy: str, entry: TaskReferences) -> list[str]:
    means = {name: each.value if each else 0.0 for name, each in entry.policies[policy].items()}
    score = entry.score(means["return"])
    return [
        policy,
        *([] if score is None else [f"{score:.1f}"]),
        f"{means['return']:.2f}",
        *(f"{100 * means[name]:.1f}" for name in ("success", "clean_success")),
        *(f"{means[name]:.2f}" for name in ("robot_collisions", "obstacle_collisions")),
    ]
