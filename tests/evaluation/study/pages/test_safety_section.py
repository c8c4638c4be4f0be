"""Success against clean success and collisions: which rows nothing exceeds."""

from swarmdata.evaluation.study.pages.safety_section import Fronts, front_sentences
from swarmdata.rollouts.score_statistics import Estimate


def at(value: float) -> Estimate:
    return Estimate(value, value - 1.0, value + 1.0)


def test_a_row_is_optimal_if_no_other_is_as_good_in_both() -> None:
    success = {"bold": 90.0, "careful": 60.0, "poor": 50.0, "idle": 0.0}
    clean = {"bold": 20.0, "careful": 55.0, "poor": 40.0, "idle": 0.0}
    crashes = {"bold": 3.0, "careful": 0.5, "poor": 1.0, "idle": 0.0}
    fronts = Fronts(
        {label: (at(clean[label]), at(success[label])) for label in success},
        {label: (at(crashes[label]), at(success[label])) for label in success},
    )
    assert fronts.cleanest == ("bold", "careful")
    assert fronts.safest == ("bold", "careful", "idle")
    assert front_sentences({"x": fronts}) == [
        "On x, Pareto-optimal in success and clean success: `bold`, `careful`; in success and "
        "collisions: `bold`, `careful`, `idle`."
    ]


def test_a_front_is_among_the_rows_that_are_shown() -> None:
    pairs = {"good": (at(50.0), at(90.0)), "fair": (at(40.0), at(80.0)), "poor": (at(1.0), at(2.0))}
    shown = Fronts(pairs, pairs).among(["poor", "fair"])
    assert shown.cleanest == ("fair",)
    assert shown.clean.keys() == shown.collisions.keys() == {"fair", "poor"}
