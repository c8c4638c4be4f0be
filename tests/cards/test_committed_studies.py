"""Committed studies are found by walking the folder, and a broken one is an error."""

from importlib.resources import files
from pathlib import Path

import pytest

from swarmdata.cards.committed_studies import committed_studies, read_estimates, read_studies
from swarmdata.errors import StudyError
from swarmdata.registry.recipes import is_dataset
from swarmdata.registry.tiers import NEWEST_VERSION

STUDIES = Path(str(files("swarmdata.cards"))) / "studies"

HEAD = "label,dataset,rewards,digest,seeds,updates,episodes,quantity,mean,low,high\n"
ROW = "bc,coop_nav-small-v0,,aa,5,4000,300,return,1.5,1,2\n"


@pytest.fixture
def place(tmp_path: Path) -> Path:
    """A folder with one study, and one of an older world beside it."""
    folder = tmp_path / "fine"
    folder.mkdir()
    (folder / "estimates.csv").write_text(HEAD + ROW)
    (folder / "study.yaml").write_text("name: fine\nblock: validation\n")
    (tmp_path / "v0" / "older").mkdir(parents=True)
    (tmp_path / "fine.yaml").write_text("name: fine\n")
    return tmp_path


def test_every_folder_with_a_plan_is_a_study_of_this_version() -> None:
    found = committed_studies()
    assert [study.name for study in found] == sorted(
        p.parent.name for p in STUDIES.glob("*/study.yaml")
    )
    assert {"regimes", "coordination"} <= {study.name for study in found}
    assert {study.name: study.chose_settings for study in found}["coordination"]
    assert not {study.name: study.chose_settings for study in found}["regimes"]
    version = f"-v{NEWEST_VERSION}"
    for row in (row for study in found for row in study.estimates if row["dataset"]):
        name, is_own, _ = row["dataset"].partition("@")[0].partition("-v0")
        assert not is_dataset(name + version) if is_own else name.endswith(version)


def test_folders_without_a_plan_are_no_studies(place: Path) -> None:
    (study,) = read_studies(place)
    assert (study.name, study.chose_settings) == ("fine", True)
    assert [row["mean"] for row in study.estimates] == ["1.5"]


@pytest.mark.parametrize("name", ["estimates.csv", "study.yaml"])
def test_half_a_study_is_an_error(name: str, place: Path) -> None:
    (place / "fine" / name).unlink()
    with pytest.raises(StudyError, match=rf"fine has no {name}"):
        read_studies(place)


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("", "no column"),
        (HEAD, "no rows"),
        ((HEAD + ROW).replace("digest,", "").replace("aa,", ""), "no column digest"),
        (HEAD + ROW.replace("1.5", "fast"), "line 2, is no estimate"),
        (HEAD + ROW + ROW.replace(",2\n", "\n"), "line 3, is no estimate"),
        (HEAD + ROW.replace("1.5", "inf"), "line 2, is no estimate"),
        (HEAD + ROW.replace(",5,", ",,"), "line 2, is no estimate"),
    ],
)  # fmt: skip
def test_a_broken_file_is_an_error(text: str, what: str) -> None:
    with pytest.raises(StudyError, match=f"x.csv.*{what}"):
        read_estimates(text, "x.csv")


def test_a_plan_without_its_seeds_is_an_error(place: Path) -> None:
    (place / "fine" / "study.yaml").write_text("name: fine\n")
    (study,) = read_studies(place)
    with pytest.raises(StudyError, match="names no `block`"):
        _ = study.chose_settings
