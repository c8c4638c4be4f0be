"""Success against clean success and collisions: which rows nothing exceeds."""

from swarmdata.evaluation.study.pages.safety import Fronts, front_table
from tests.support.measured import at


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
    row = front_table({"x": fronts}).splitlines()[-1]
    assert row == "| x | `bold`, `careful` | `bold`, `careful`, `idle` |"
