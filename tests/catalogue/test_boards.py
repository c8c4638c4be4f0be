"""Leaderboards: one study at one budget first, best first, nothing twice, the rest apart."""

from dataclasses import replace

from swarmdata.catalogue.boards import Board, boards
from swarmdata.catalogue.result_sources import Outcome, ResultSource
from swarmdata.rollouts.score_statistics import Estimate

DATA = "coop_nav-medium-v1"


def outcome(label: str, score: float, updates: str = "9000", **changes: object) -> Outcome:
    found = Outcome(label, "cloning", DATA, {"score": Estimate(score, 0, 1)}, 5, updates, "", ())
    return replace(found, **changes)  # type: ignore[arg-type]


def source(name: str, *outcomes: Outcome, is_own: bool = False) -> ResultSource:
    place = name if is_own else f"cards/studies/{name}"
    return ResultSource(name, place, outcomes, {DATA: 57.0}, is_own=is_own)


def labels(board: Board, group: str) -> list[str]:
    return [row.outcome.label for row in board.rows if row.group == group]


LARGE = source(
    "large",
    outcome("bc", 50.0),
    outcome("iql", 80.0),
    outcome("vdn", 70.0),
    outcome("bc", 60.0, updates="18000"),
    outcome("iql-without", 90.0, family="ablations"),
    outcome("vdn", 99.0, rewards='{"success": 5}'),
)


def test_the_study_with_most_algorithms_gives_the_first_group_at_one_budget() -> None:
    small = source("small", outcome("bc", 95.0, updates="4500"), outcome("bc-gru", 96.0))

    (board,) = boards([small, LARGE])

    assert labels(board, "algorithms") == ["iql", "vdn", "bc"]
    assert board.study is LARGE
    assert labels(board, "variants") == ["vdn", "iql-without"]
    assert labels(board, "others") == ["bc-gru", "bc", "bc"]
    assert board.data == 57.0


def test_what_two_studies_share_is_there_once_and_of_the_larger() -> None:
    small = source("a-small", outcome("iql", 80.0), outcome("omar", 10.0))

    (board,) = boards([small, LARGE])

    (iql,) = [row for row in board.rows if row.outcome.label == "iql"]
    assert iql.source is LARGE
    assert labels(board, "others") == ["bc", "omar"]


def test_own_algorithms_compare_with_the_first_group_at_any_budget() -> None:
    own = source(
        "mine",
        outcome("bc", 55.0, updates="300"),
        outcome("new_method", 65.0, family="new_method"),
        outcome("new_method-without", 20.0, family="ablations"),
        is_own=True,
    )

    (board,) = boards([LARGE, own])

    assert labels(board, "algorithms") == ["iql", "vdn", "new_method", "bc", "bc"]
    assert "new_method-without" in labels(board, "variants")


def test_a_view_of_a_dataset_has_a_board_of_its_own() -> None:
    seen = source("views", outcome("bc", 5.0, dataset=f"{DATA}@lidar"))

    plain, lidar = boards([LARGE, seen])

    assert (plain.name, lidar.name) == (DATA, DATA)
    assert lidar.dataset == f"{DATA}@lidar"
    assert lidar.data is None
