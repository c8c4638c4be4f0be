"""Transfers in sentences: which view is best to learn with."""

from swarmdata.evaluation.study.answers.conditions.transferred_views import teachers


def test_another_view_may_be_better_to_learn_with() -> None:
    found = {
        "recorded": {"recorded": 90.0, "lossy": 80.0, "slow": 66.0},
        "lossy": {"recorded": 70.0, "lossy": 65.0, "slow": 30.0},
        "slow": {"recorded": 30.0, "lossy": 34.0, "slow": 35.0},
        "silent": {"silent": 38.0},  # other inputs: no view to compare with
    }
    assert teachers("search-expert", "bc", found) == [
        "On search-expert, in 1 of 3 views of use `bc` solves most if it learned with the same "
        "view, and in 2 if it learned with `recorded`; most of all with `slow`: 66 % instead of "
        "35 %."
    ]


def test_nothing_is_said_where_the_same_view_is_always_best() -> None:
    found = {"near": {"near": 50.0, "far": 50.0}, "far": {"near": 40.0, "far": 50.0}}
    assert teachers("x", "bc", found) == []
