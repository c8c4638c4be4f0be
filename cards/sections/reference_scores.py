"""The section of a card with reference policies: performance, score, coordination gaps."""

from swarmdata.cards.references import gap_section
from swarmdata.drawing import markdown
from swarmdata.registry.published import (
    REFERENCE_OPPONENTS,
    Interval,
    TaskReferences,
    side_references,
)
from swarmdata.rollouts.metrics import EPISODE_METRICS, SOLVED_TIME
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.store.arrays.layout import REFERENCES

REFERENCES_TITLE = "\n## Reference scores\n"

REFERENCE_METRICS = ("return", "success", "clean_success", "time_to_goal", "robot_collisions",
                     "obstacle_collisions")  # fmt: skip


def references_section(
    known: TaskReferences | None,
    spec: TaskSpec,
    mean_return: float,
    *,
    has_task_rewards: bool = True,
) -> str:
    """Returns the section of a dataset, or that nothing was measured.

    A dataset whose rewards are not those of the spec has no score.
    """
    if known is None:
        return f"{REFERENCES_TITLE}\n{_of_sides(spec)}"
    score = known.score(mean_return)
    anchors = "There is no score yet, because no expert was measured.\n"
    if not has_task_rewards:
        anchors = "This dataset has no score: its rewards are not those of the task.\n"
    elif score is not None:
        anchors = f"{_scale(known)} The mean return of this dataset scores {score:.1f}.\n"
    return (
        f"{REFERENCES_TITLE}\n{_table(known)}\n"
        f"{_how(known)} {anchors}"
        f"`{REFERENCES}` beside this card has all metrics at full precision.\n"
        + gap_section(known, spec.rules.naive_teams)
    )


def _of_sides(spec: TaskSpec) -> str:
    """The references of each side, or that nothing was measured."""
    tables = [
        f"The {side}, against the {REFERENCE_OPPONENTS} others:\n\n{_table(known)}\n{_how(known)} "
        f"{_scale(known)}\n{gap_section(known, spec.rules.naive_teams)}"
        for side, known in side_references(spec).items()
    ]
    return "\n".join(tables) or "No reference policies were measured for this spec.\n"


def _table(known: TaskReferences) -> str:
    rows = [
        (policy, *(_interval(metrics.get(name)) for name in REFERENCE_METRICS))
        for policy, metrics in known.policies.items()
    ]
    labels = tuple(
        SOLVED_TIME if name == "time_to_goal" else EPISODE_METRICS[name].label
        for name in REFERENCE_METRICS
    )
    return markdown.table(("policy", *labels), rows)


def _how(known: TaskReferences) -> str:
    return (
        f"Means over {known.n_episodes:,} reserved evaluation seeds with 95 % bootstrap "
        "intervals; the policies act without noise."
    )


def _scale(known: TaskReferences) -> str:
    """The formula of the score; empty where no expert was measured."""
    if known.reference is None:
        return ""
    return (
        f"Score = 100 (R - R0) / (R1 - R0) with R0 = {known.no_skill:.3f}, the better of the "
        f"idle and the random team, and R1 = {known.expert:.3f}, the expert."
    )


def _interval(interval: Interval | None) -> str:
    if interval is None:
        return "never"
    return f"{interval.value:.3f} [{interval.low:.3f}, {interval.high:.3f}]"
