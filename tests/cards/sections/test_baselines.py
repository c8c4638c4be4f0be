"""Baselines on cards: of this dataset and this content only, the best first."""

from swarmdata.behavior_policies.tiers import NEWEST_VERSION, shipped_recipes
from swarmdata.cards.sections.baselines import (
    BASELINE_COLUMNS,
    baselines_section,
    read_estimates,
    study_estimates,
)
from swarmdata.rollouts.score_intervals import TARGET_OF_SEVERAL

Rows = list[dict[str, str]]


def make_rows(label: str, team_return: float, **changes: str) -> Rows:
    """The rows of an algorithm: 0.5 of everything but the return."""
    shared = {"label": label, "family": "cloning", "dataset": "coop_nav-small-v0", "rewards": ""}
    shared |= {"digest": "a" * 64, "seeds": "5", "updates": "4000", "episodes": "300"} | changes
    found = {name: 0.5 for name, *_ in BASELINE_COLUMNS} | {"return": team_return}
    return [
        {**shared, "quantity": name, "mean": str(v), "low": str(v - 0.25), "high": str(v + 0.25)}
        for name, v in found.items()
    ]


def section(*rows: Rows) -> str:
    return baselines_section("coop_nav-small-v0", "a" * 64, [row for each in rows for row in each])


def test_the_best_comes_first_with_its_seeds_updates_and_intervals() -> None:
    text = section(make_rows("bc", 1.0), make_rows("omar", 2.5))
    rows = [line for line in text.splitlines() if line.startswith("| `")]
    assert [row.split(" | ")[0] for row in rows] == ["| `omar`", "| `bc`"]
    assert "| 5 | 4,000 | 0.5 [0.2, 0.8] | 2.50 [2.25, 2.75] | 50.0 [25.0, 75.0] |" in rows[0]
    assert "300 reserved evaluation seeds" in text
    assert f"95 % intervals for {TARGET_OF_SEVERAL}." in text


def test_other_datasets_and_other_content_are_not_shown() -> None:
    assert "No study has been run on this dataset yet.\n" in section()
    assert "No study has been run on this dataset yet.\n" in section(
        make_rows("bc", 1.0, dataset="other-v0")
    )
    assert "used other data with this id" in section(make_rows("bc", 1.0, digest="b" * 64))


def test_what_was_not_measured_is_a_dash_and_one_episode_has_no_interval() -> None:
    rows = [row for row in make_rows("bc", 1.0) if row["quantity"] != "score"]
    rows[0] |= {"low": "", "high": ""}
    assert "| 4,000 | – | 1.00 | 50.0 [" in section(rows)


def test_rows_that_learned_from_other_rewards_are_no_baselines() -> None:
    text = section(make_rows("bc", 1.0), make_rows("bc-safe", 2.0, rewards='{"time": 9.0}'))
    assert "| `bc` |" in text
    assert "bc-safe" not in text


def test_the_committed_studies_can_be_read() -> None:
    for row in (row for row in study_estimates() if row["dataset"]):
        assert row["dataset"].endswith(f"-v{NEWEST_VERSION}")


def test_no_card_shows_baselines_of_a_replaced_version() -> None:
    for key in shipped_recipes():
        shown = [row for row in study_estimates() if row["dataset"] == key]
        text = baselines_section(key, "a" * 64, study_estimates())
        assert text.endswith("No study has been run on this dataset yet.\n") == (not shown)


def test_rows_of_a_file_are_estimates() -> None:
    (row,) = read_estimates("label,mean\nbc,1.5\n")
    assert row == {"label": "bc", "mean": "1.5"}
