"""Success against clean success and collisions: which rows nothing exceeds."""

from swarmdata.evaluation.study.pages.safety import pareto_optimal
from tests.support.measured import at


def test_a_row_is_optimal_if_no_other_is_as_good_in_both() -> None:
    success = {"bold": at(90.0), "careful": at(60.0), "poor": at(50.0), "idle": at(0.0)}
    clean = {"bold": at(20.0), "careful": at(55.0), "poor": at(40.0), "idle": at(0.0)}
    crashes = {"bold": at(3.0), "careful": at(0.5), "poor": at(1.0), "idle": at(0.0)}
    assert pareto_optimal(success, clean, more=True) == ["bold", "careful"]
    assert pareto_optimal(success, crashes, more=False) == ["bold", "careful", "idle"]
