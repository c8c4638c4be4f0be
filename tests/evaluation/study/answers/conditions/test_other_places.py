"""What policies solve in other tasks, in words."""

from swarmdata.evaluation.study.answers.conditions.other_places import (
    most_solved,
    place_sentences,
)
from swarmdata.evaluation.study.shifts.shift_table import Shifted
from swarmdata.rollouts.score_statistics import Estimate


def shifted(label: str, task: str, success: float | None) -> Shifted:
    """Policies in another task; None: they do not fit."""
    found = {"success": success, "clean_success": success}
    estimates = {k: Estimate(v, v, v) for k, v in found.items() if v is not None}
    return Shifted("nav", label, "", task, 5, 200, estimates)


def test_the_best_policies_of_each_task_are_named() -> None:
    rows = [
        shifted("bc", "easy", 0.25), shifted("sets", "easy", 0.5),
        shifted("bc", "swap", 0.0), shifted("sets", "swap", 0.0),
        shifted("bc", "large", None), shifted("sets", "large", None),
    ]  # fmt: skip
    easy, swap, large = place_sentences("nav", rows)
    assert easy.startswith("On easy, of policies that learned on nav, those of `sets` solve most: ")
    assert "50.0 [50.0, 50.0] % of 200 episodes" in easy
    assert swap == "On swap, no policies that learned on nav solve any of 200 episodes."
    assert large == "On large, no policies that learned on nav fit."
    assert most_solved("nav", rows) == "The best policies from nav solve 50 % of easy, 0 % of swap."
    assert most_solved("nav", rows[-2:]) == (
        "The best policies from nav solve no task that they fit."
    )
