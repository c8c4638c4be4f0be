"""Baselines on cards: of this dataset and this content only, from one study, the best first."""

from pathlib import Path

import pytest

from swarmdata.cards.committed_studies import CommittedStudy, Means
from swarmdata.cards.sections.baselines import BASELINE_COLUMNS, baselines_section
from swarmdata.rollouts.score_intervals import TARGET_OF_SEVERAL

Rows = list[Means]


def make_rows(label: str, team_return: float, **changes: str) -> Rows:
    """The rows of an algorithm: 0.5 of everything but the return."""
    shared = {"label": label, "family": "cloning", "dataset": "coop_nav-small-v0", "rewards": ""}
    shared |= {"digest": "a" * 64, "seeds": "5", "updates": "4000", "episodes": "300"} | changes
    found = {name: 0.5 for name, *_ in BASELINE_COLUMNS} | {"return": team_return}
    return [
        {**shared, "quantity": name, "mean": str(v), "low": str(v - 0.25), "high": str(v + 0.25)}
        for name, v in found.items()
    ]


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def study(name: str, *rows: Rows, block: str = "evaluation") -> CommittedStudy:
    folder = Path(name)
    folder.mkdir(exist_ok=True)
    (folder / "study.yaml").write_text(f"block: {block}\n")
    return CommittedStudy(folder, tuple(row for each in rows for row in each))


def section(*studies: CommittedStudy) -> str:
    return baselines_section("coop_nav-small-v0", "a" * 64, studies)


def labels(text: str) -> list[str]:
    return [line.split("`")[1] for line in text.splitlines() if line.startswith("| `")]


def test_the_best_comes_first_with_intervals_and_where_they_come_from() -> None:
    text = section(study("tiny", make_rows("bc", 1.0), make_rows("omar", 2.5)))
    assert labels(text) == ["omar", "bc"]
    assert "| `omar` | 0.5 [0.2, 0.8] | 50.0 [25.0, 75.0] |\n" in text
    assert "the study `tiny`: the last policies of 5 training seeds after 4,000 updates" in text
    assert "on 300 reserved evaluation seeds" in text
    assert f"95 % intervals for {TARGET_OF_SEVERAL}." in text
    assert "Other studies" not in text


def test_rows_are_of_the_study_with_the_most_algorithms_and_the_others_are_named() -> None:
    few = study("few", make_rows("bc", 9.0))
    many = study("many", make_rows("bc", 1.0), make_rows("iql", 2.0))
    text = section(few, many)
    assert labels(text) == ["iql", "bc"]
    assert "study `many`" in text
    assert text.endswith("Other studies of this dataset: `few`.\n")


def test_studies_that_chose_settings_come_after_all_others() -> None:
    many = make_rows("bc", 1.0), make_rows("iql", 2.0)
    chose = study("chose", *many, block="validation")
    assert labels(section(chose, study("few", make_rows("vdn", 9.0)))) == ["vdn"]
    assert "on 300 validation seeds" in section(chose)


def test_other_datasets_and_other_content_are_not_shown() -> None:
    none = "No results on this dataset yet.\n"
    assert none in section()
    assert none in section(study("tiny", make_rows("bc", 1.0, dataset="other-v0")))
    other = study("tiny", make_rows("bc", 1.0, digest="b" * 64))
    assert "used other data with this id" in section(other)


def test_studies_of_sides_are_named() -> None:
    of_a_side = make_rows("bc", 1.0, dataset="coop_nav-small-v0@pursuers")
    assert section(study("sides", of_a_side)).endswith("Studies of its sides: `sides`.\n")
    assert "No results" in section(study("sides", make_rows("bc", 1.0, dataset="other-v0@evader")))


def test_a_mini_names_the_card_with_the_results_on_the_whole_dataset() -> None:
    whole = study("tiny", make_rows("bc", 1.0, dataset="coop_nav-x-v1"))
    text = baselines_section("coop_nav-x-mini-v1", "c" * 64, [whole])
    assert "the card of `coop_nav-x-v1`" in text
    assert "card of" not in baselines_section("coop_nav-y-mini-v1", "c" * 64, [whole])


def test_what_was_not_measured_is_a_dash_and_one_episode_has_no_interval() -> None:
    rows = [row for row in make_rows("bc", 1.0) if row["quantity"] != "score"]
    rows[0] = {**rows[0], "low": "", "high": ""}
    assert "| `bc` | – | 50.0 |\n" in section(study("tiny", rows))


def test_variants_and_what_learned_from_other_rewards_are_no_baselines() -> None:
    others = make_rows("bc-gru", 2.0), make_rows("iql", 2.0, rewards='{"time": 9.0}')
    assert labels(section(study("tiny", make_rows("bc", 1.0), *others))) == ["bc"]
    text = section(study("tiny", *others))
    assert labels(text) == []
    assert "Studies of variants of algorithms: `tiny`." in text
