"""Baselines on cards: of this dataset and this content only, the best first."""

from importlib.resources import files

from hypothesis import given
from hypothesis import strategies as st

from swarmdata.behavior_policies.tiers import NEWEST_VERSION, shipped_recipes
from swarmdata.cards.sections.baselines import (
    BASELINE_COLUMNS,
    RESULTS_FILE,
    baselines_section,
    read_runs,
    study_runs,
)
from swarmdata.registry.replaced_worlds import REPLACED_IDS

NAMES = (
    "label",
    "family",
    "dataset",
    "digest",
    "updates",
    "episodes",
    *(n for n, *_ in BASELINE_COLUMNS),
)


def make_run(label: str, team_return: float, **changes: str) -> dict[str, str]:
    run = dict.fromkeys(NAMES, "0.5") | {"label": label, "family": "cloning"}
    run |= {"dataset": "coop_nav-small-v0", "digest": "a" * 64, "updates": "4000"}
    return run | {"episodes": "300", "return": str(team_return)} | changes


def section(*runs: dict[str, str]) -> str:
    return baselines_section("coop_nav-small-v0", "a" * 64, runs)


def test_the_best_comes_first_with_its_seeds_and_updates() -> None:
    text = section(make_run("bc", 1.0), make_run("omar", 2.0), make_run("omar", 3.0))
    rows = [line for line in text.splitlines() if line.startswith("| `")]
    assert [row.split(" | ")[0] for row in rows] == ["| `omar`", "| `bc`"]
    assert "| 2 | 4,000 |" in rows[0]
    assert "2.50 [2.00, 3.00]" in rows[0]
    assert "300 reserved evaluation seeds" in text


def test_other_datasets_and_other_content_are_not_shown() -> None:
    assert "No study has been run on this dataset yet.\n" in section()
    assert "No study has been run on this dataset yet.\n" in section(
        make_run("bc", 1.0, dataset="other-v0")
    )
    assert "used other data with this id" in section(make_run("bc", 1.0, digest="b" * 64))


def test_a_world_without_references_has_no_score() -> None:
    assert "| 4,000 | – | 1.00 [1.00, 1.00] |" in section(make_run("bc", 1.0, score=""))


@given(st.lists(st.floats(-50, 50), min_size=1, max_size=6))
def test_intervals_hold_the_values(returns: list[float]) -> None:
    text = section(*(make_run("bc", value) for value in returns))
    cell = next(line for line in text.splitlines() if "`bc`" in line).split(" | ")[5]
    value, low, high = (float(each.strip(",[]")) for each in cell.split())
    assert min(returns) - 0.01 <= low <= value <= high <= max(returns) + 0.01


def test_the_committed_studies_can_be_read() -> None:
    """Those of this version, as they are there, are of its datasets; the old ones stay readable."""
    for run in (run for run in study_runs() if run["dataset"]):
        assert run["dataset"].endswith(f"-v{NEWEST_VERSION}")
        assert set(NAMES) <= set(run)
    for study in ("coop_nav", "formation"):
        text = (files("swarmdata.cards") / "studies/v0" / study / RESULTS_FILE).read_text("utf-8")
        ids = {run["dataset"] for run in read_runs(text)} - {""}  # online runs have no dataset
        assert ids & REPLACED_IDS
        assert {each.rpartition("-")[2] for each in ids} == {"v0"}


def test_no_card_shows_baselines_of_a_replaced_version() -> None:
    for key in shipped_recipes():
        shown = [run for run in study_runs() if run["dataset"] == key]
        text = baselines_section(key, "a" * 64, study_runs())
        assert text.endswith("No study has been run on this dataset yet.\n") == (not shown)


def test_rows_of_a_file_are_runs() -> None:
    (run,) = read_runs("label,return\nbc,1.5\n")
    assert run == {"label": "bc", "return": "1.5"}
