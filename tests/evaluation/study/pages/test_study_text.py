"""Sentences follow from the numbers, whatever they are."""

from collections.abc import Mapping

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from swarmdata.evaluation.results.estimate_table import Column
from swarmdata.evaluation.study.pages import study_text
from swarmdata.evaluation.study.pages.csv_tables import to_csv
from swarmdata.evaluation.study.pages.scoreboard import Scoreboard
from swarmdata.evaluation.study.pages.study_tables import duration, scoreboard_table
from swarmdata.rollouts.score_intervals import difference_interval, mean_interval

FAMILIES = {"bc": "cloning", "vdn": "values", "qmix": "values", "omar": "critics"}
HARD = np.array([-2.0, -1.0, 1.0, 2.0])  # how episodes differ
SCORE, CLEAN = Column("score", "score", "", 1), Column("clean", "clean success", "%", 1, 100.0)


def make_board(
    scores: Mapping[str, Mapping[str, float]],
    data: Mapping[str, float],
    width: float = 1.0,
    column: Column = SCORE,
) -> Scoreboard:
    """Four seeds that agree on four episodes, which differ alike for all labels."""
    hard = mean_interval(HARD[None])
    offsets = width * HARD / (hard.high - hard.value)
    values = {
        dataset: {k: np.repeat(v + offsets[None], 4, axis=0) for k, v in found.items()}
        for dataset, found in scores.items()
    }
    return Scoreboard(column, values, data, FAMILIES)


BOARD = make_board(
    {"x-v0": {"bc": 10, "vdn": 30, "qmix": 29, "omar": 20}, "y-v0": {"bc": 90, "vdn": -9}},
    {"x-v0": 15, "y-v0": 100},
)


def test_winners_say_by_how_much_and_whether_it_is_certain() -> None:
    first, second = study_text.winners(BOARD)
    assert first == (
        "On x, `vdn` (values) is best with 30.0 [29.0, 31.0]. The best algorithm of another "
        "family, `omar` (critics), reaches 20.0 [19.0, 21.0], which is 10.0 [10.0, 10.0] less, "
        "paired by episode. The mean of the data is 15.0; `vdn` is 15.0 [14.0, 16.0] above it (2.0 "
        "times as much)."
    )
    assert "`bc` is 10.0 [9.0, 11.0] below it (0.9 times as much)." in second
    equal = study_text.winners(make_board({"x": {"bc": 2, "vdn": 2}}, {}))[0]
    assert "which is 0.0 [0.0, 0.0] less, paired by episode; this may be chance" in equal


def test_ablations_that_exceed_the_best_are_named() -> None:
    scores = {"x-v0": {"bc": 10, "vdn": 30, "qmix": 34, "omar": 29}, "y": {"bc": 9, "qmix": 8}}
    whole = make_board(scores, {})
    counted = {label: family for label, family in FAMILIES.items() if label != "qmix"}
    values = {
        name: {label: each for label, each in found.items() if label in counted}
        for name, found in whole.values.items()
    }
    board = Scoreboard(SCORE, values, {}, counted)
    assert study_text.ablations_ahead(board, whole) == [
        "Ablations do not count as algorithms; on x, some are clearly better than the best "
        "algorithm, `vdn`, paired by episode: `qmix` by 4.0 [4.0, 4.0]."
    ]
    assert study_text.ablations_ahead(whole, whole) == []


def test_bold_are_those_that_are_not_clearly_worse() -> None:
    rng = np.random.default_rng(0)
    hard = 50 * rng.normal(size=(1, 40))
    means = {"bc": 0.0, "vdn": 9.0, "qmix": 10.0}
    values = {label: mean + hard + rng.normal(size=(4, 40)) * 8 for label, mean in means.items()}
    board = Scoreboard(SCORE, {"x": values}, {}, FAMILIES)
    assert board.estimates["x"]["bc"].high > board.estimates["x"]["qmix"].low  # they overlap
    assert set(board.leaders("x")) == {"vdn", "qmix"}
    gap = board.lead("x", "qmix", "bc")
    assert gap == difference_interval(values["qmix"], values["bc"])
    assert gap.low > 0.0


def test_families_win_and_lag() -> None:
    sentences = study_text.families(BOARD)
    assert sentences[0].startswith("Cloning has the best algorithm on 1 of 2 datasets (y)")
    assert (
        "Its best algorithm is 49.5 behind the overall best on average, and at most 99.0."
        in sentences[1]
    )
    assert "on 0 of 1 datasets. Its best algorithm is 10.0 behind" in sentences[2]
    assert study_text.families(make_board({"x": {"bc": 1, "vdn": 2}}, {})) == []  # winners says it


def test_a_family_does_not_win_for_want_of_others() -> None:
    board = make_board(
        {"x": {"bc": 1, "vdn": 2, "omar": 3}, "y": {"bc": 3, "omar": 2}, "z-v0": {"bc": 1}}, {}
    )
    sentences = study_text.families(board)
    assert sentences[0].startswith("Cloning has the best algorithm on 1 of 2 datasets (y)")
    assert sentences[-1] == ("Not counted: z, where at most half of the families were measured.")
    assert study_text.winners(board)[2].startswith(
        "On z, `bc` (cloning) is best with 1.0 [0.0, 2.0]. No other family was measured there."
    )


def test_the_best_families_in_short() -> None:
    board = make_board(
        {"x": {"bc": 1, "vdn": 2, "omar": 6}, "y": {"bc": 3, "omar": 2}, "z-v0": {"bc": 1}}, {}
    )
    assert study_text.best_families(board) == (
        "Cloning has the best algorithm on 1 of 2 datasets, critics on 1. On average the best "
        "algorithm of a family is behind the best of all by 0.5 (critics), 2.5 (cloning)."
    )
    assert study_text.best_families(make_board({"x": {"bc": 1, "vdn": 2}}, {})) == ""


def test_good_data_count_apart() -> None:
    scores = {
        "x-v0": {"bc": 1, "vdn": 2, "omar": 6},
        "y-v0": {"bc": 2, "omar": 3},
        "z-v0": {"bc": 9, "vdn": 8},
    }
    board = make_board(scores, {"x-v0": 20, "y-v0": 70, "z-v0": 99})
    assert study_text.best_families(board).startswith(
        "Of data that score below 70, where experts have 100, critics has the best algorithm on 1 "
        "of 1 dataset; of better data, cloning has the best algorithm on 1 of 2 datasets, critics "
        "on 1. On average "
    )
    all_good = make_board(scores, dict.fromkeys(scores, 80.0))
    returns = make_board(
        scores, {"x-v0": 20, "y-v0": 70, "z-v0": 99}, column=Column("return", "return", "", 1)
    )
    for other in (all_good, returns):
        assert study_text.best_families(other).startswith(
            "Critics has the best algorithm on 2 of 3"
        )


def test_every_algorithm_stands_on_one_side_of_the_data() -> None:
    first, second = study_text.against_data(BOARD)
    assert first == (
        "x, where the mean of the data is 15.0: above it with the whole interval: `vdn`, `qmix`, "
        "`omar`; below it with the whole interval: `bc`."
    )
    assert "below it with the whole interval: `bc`, `vdn`" in second
    wide = make_board({"x": {"bc": 10, "vdn": 30}}, {"x": 15}, width=6)
    assert "within the interval: `bc`" in study_text.against_data(wide)[0]


def test_surprises_are_shifts_touches_and_online_teams() -> None:
    scores = {"x": {"bc": 1, "vdn": 9, "qmix": 8, "omar": 7}}
    scores["y"] = {"bc": 9, "vdn": 2, "qmix": 3, "omar": 4}
    clean = make_board({"x": {"vdn": 0.2, "bc": 0.7}}, {}, width=0.01, column=CLEAN)
    board = make_board(scores, {})
    strong, weak = ({"mappo": np.full((2, 4), value)} for value in (8.5, 1.5))
    sentences = study_text.surprises(board, clean, {"x": strong, "y": strong})
    assert "`bc` has rank 1 of 4 on y, but rank 4 of 4 on x." in sentences
    assert any("`vdn` solves 20.0 [19.0, 21.0] % of the episodes" in each for each in sentences)
    assert sentences[-1].endswith("exceeds it, paired by episode, on 0 of 2 datasets.")
    last = study_text.surprises(board, clean, {"x": weak, "y": weak})[-1]
    assert last.endswith("exceeds it, paired by episode, on 2 of 2 datasets (x, y).")
    assert "`mappo`, reaches 1.5 [1.5, 1.5]; the best" in last


def test_online_algorithms_are_compared_in_their_own_worlds() -> None:
    board = make_board({"x": {"bc": 5}, "y": {"bc": 5}}, {})
    online = {"x": {"mappo-x": np.full((2, 4), 8.0)}, "y": {"mappo-y": np.full((2, 4), 1.0)}}
    first, second = study_text.surprises(board, board, online)[-2:]
    assert "`mappo-x`, reaches 8.0" in first
    assert first.endswith("on 0 of 1 datasets.")
    assert "`mappo-y`, reaches 1.0" in second
    assert second.endswith("on 1 of 1 datasets (y).")


def test_failures_are_cells_worse_teams_and_seeds_apart() -> None:
    missing = {"omar/y": "not run yet", "iql/y": "not run yet", "bc/z": "ValueError: oh"}
    sentences = study_text.failures(BOARD, missing)
    assert sentences[0] == "`vdn` scores below no skill with its whole interval on y."
    assert sentences[-2:] == [
        "On y, `omar`, `iql` have no results: not run yet.",
        "On z, `bc` has no results: ValueError: oh.",
    ]
    many = {f"a{k}/y": "not run yet" for k in range(9)}
    assert (
        study_text.failures(BOARD, many)[-1] == "On y, 9 algorithms have no results: not run yet."
    )
    assert study_text.failures(make_board({}, {}), {})[0].startswith("No cell failed")


NUMBERS = st.integers(-100, 100).map(float)
SCORES = st.dictionaries(st.sampled_from(sorted(FAMILIES)), NUMBERS, min_size=1)


@given(st.dictionaries(st.sampled_from(["x", "y"]), SCORES, min_size=1), NUMBERS, st.floats(0, 20))
def test_any_numbers_give_sentences_that_agree_with_the_table(
    scores: dict[str, dict[str, float]], own: float, width: float
) -> None:
    board = make_board(scores, dict.fromkeys(scores, own), width)
    table = scoreboard_table(board)
    for dataset, sentence in zip(board.estimates, study_text.winners(board), strict=True):
        best = board.ranking(dataset)[0]
        assert scores[dataset][best] == max(scores[dataset].values())
        assert f"`{best}`" in sentence
        assert best in board.leaders(dataset)
    assert table.count("**") == 2 * sum(len(board.leaders(dataset)) for dataset in scores)
    groups = " ".join(study_text.against_data(board))
    assert sum(groups.count(f"`{label}`") for label in FAMILIES) == sum(map(len, scores.values()))
    for sentences in (
        study_text.families(board),
        study_text.surprises(board, board, {}),
        study_text.failures(board, {}),
    ):
        assert all(each.endswith(".") for each in sentences)


def test_durations_and_tables_are_readable() -> None:
    assert [duration(s) for s in (42, 210, 7560)] == ["42 s", "3.5 min", "2.1 h"]
    rows: list[dict[str, object]] = [{"a": 1, "b": 0.1}, {"a": None, "c": "x", "b": float("nan")}]
    assert to_csv(rows) == "a,b,c\n1,0.1,\n,,x\n"
