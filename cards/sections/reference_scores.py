"""The section of a card with reference policies: performance, score, coordination gaps."""

from swarmdata.cards.references import gap_section
from swarmdata.drawing import markdown
from swarmdata.registry.published import Interval, TaskReferences
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
        return f"{REFERENCES_TITLE}\nNo reference policies were measured for this spec.\n"
    rows = [
        (policy, *(_interval(metrics.get(name)) for name in REFERENCE_METRICS))
        for policy, metrics in known.policies.items()
    ]
    score = known.score(mean_return)
    anchors = "There is no score yet, because no expert was measured.\n"
    if not has_task_rewards:
        anchors = "This dataset has no score: its rewards are not those of the task.\n"
    elif score is not None:
        anchors = (
            f"Score = 100 (R - R0) / (R1 - R0) with R0 = {known.no_skill:.3f}, the better of the "
            f"idle and the random team, and R1 = {known.expert:.3f}, the expert. The mean return "
            f"of this dataset scores {score:.1f}.\n"
        )
    labels = tuple(
        SOLVED_TIME if name == "time_to_goal" else EPISODE_METRICS[name].label
        for name in REFERENCE_METRICS
    )
    return (
        f"{REFERENCES_TITLE}\n"
        + markdown.table(("policy", *labels), rows)
        + f"\nMeans over {known.n_episodes:,} reserved evaluation seeds with 95 % bootstrap "
        f"intervals; the policies act without noise. {anchors}"
        f"`{REFERENCES}` beside this card has all metrics at full precision.\n"
        + gap_section(known, spec.rules.naive_teams)
    )


def _interval(interval: Interval | None) -> str:
    if interval is None:
        return "never"
    return f"{interval.value:.3f} [{interval.low:.3f}, {interval.high:.3f}]"
