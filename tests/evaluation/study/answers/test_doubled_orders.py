"""Orders of families before and after doubling, in words."""

from swarmdata.evaluation.study.answers.doubled_orders import (
    Doubled,
    order_sentences,
    orders_kept,
)
from swarmdata.evaluation.study.pages.row_differences import Verdict


def order(before: Verdict, after: Verdict, dataset: str = "data", updates: int = 1_000) -> Doubled:
    return Doubled("cloning", "in-sample", dataset, updates, before, after)


def test_what_changes_is_named_and_what_stays_is_counted() -> None:
    doubled = [
        order("higher", "lower", "x"),
        order("lower", "no clear change", "y"),
        order("no clear change", "higher", "z"),
        order("higher", "higher"),
        order("no clear change", "no clear change"),
        order("lower", "lower", updates=2_000),
    ]
    assert order_sentences(doubled) == [
        "Orders of two families on 4 datasets: of 5, doubling 1,000 updates leaves 2 as they are, "
        "turns 1 (cloning and in-sample on x) round, makes 1 (cloning and in-sample on z) clear "
        "that were not, and leaves 1 (cloning and in-sample on y) no longer clear.",
        "Orders of two families on one dataset: of 1, doubling 2,000 updates leaves 1 as they are, "
        "turns 0 round, makes 0 clear that were not, and leaves 0 no longer clear.",
    ]
    assert orders_kept(doubled) == (
        "Of the orders of two families, doubling 1,000 updates leaves 2 of 5 as they are and turns "
        "1 round; doubling 2,000 updates leaves 1 of 1 as they are and turns 0 round."
    )


def test_only_clear_orders_turn_round() -> None:
    assert order("lower", "higher").is_turned_round
    assert not order("no clear change", "higher").is_turned_round
    assert not order("higher", "higher").is_turned_round
