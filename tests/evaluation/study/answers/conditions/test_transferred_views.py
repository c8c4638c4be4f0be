"""Transfers in sentences: which view is best to learn with."""

from swarmdata.evaluation.study.answers.conditions.transferred_views import (
    SCORE,
    all_round,
    fitting,
    teachers,
)


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


def test_small_advantages_are_not_spoken_of() -> None:
    found = {
        "near": {"near": 0.4, "far": 50.0, "none": 9.0},
        "far": {"near": 0.9, "far": 50.0, "none": 8.5},
        "none": {"near": 0.0, "far": 40.0, "none": 9.4},
    }
    assert teachers("x", "bc", found) == []
    assert all_round("x", "bc", found) == []


def test_where_few_episodes_are_solved_scores_tell_views_apart() -> None:
    found = {"near": {"near": 20.0, "far": -30.0}, "far": {"near": 24.4, "far": -40.0}}
    assert teachers("coop_nav-medium-replay", "bc", found, SCORE) == [
        "On coop_nav-medium-replay, in 0 of 2 views of use `bc` scores most if it learned with the "
        "same view, and in 1 if it learned with `far`; most of all with `near`: 24 instead of 20."
    ]


def test_views_that_fit_no_other_are_left_out() -> None:
    found = {
        "near": {"near": 50.0, "far": 50.0},
        "far": {"far": 50.0},
        "silent": {"silent": 38.0},
    }
    assert list(fitting(found)) == ["near", "far"]


def test_the_best_view_for_all_uses_is_that_which_is_best_where_it_is_worst() -> None:
    found = {
        "perfect": {"perfect": 78.0, "lossy": 69.0, "slow": 0.0},
        "lossy": {"perfect": 75.0, "lossy": 73.0, "slow": 60.0},
        "slow": {"perfect": 60.0, "lossy": 57.0, "slow": 66.0},
    }
    assert all_round("formation-expert", "bc", found) == [
        "On formation-expert, `bc` that learned with `lossy` solves 60 % or more with each of the "
        "3 views, after `slow`: 57 %."
    ]
    del found["slow"]["perfect"]  # not tried there: nothing is known of the worst
    assert "after `perfect`: 0 %" in all_round("formation-expert", "bc", found)[0]
    del found["perfect"]["slow"]
    assert all_round("formation-expert", "bc", found) == []
