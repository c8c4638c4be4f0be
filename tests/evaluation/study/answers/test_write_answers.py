"""Pages of answers: the committed ones are current, and a study gets every page it can answer."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

pytest.importorskip("torch", reason="a study needs the torch extra")
pytest.importorskip("matplotlib", reason="figures need the plots extra")

from swarmdata.errors import StudyError
from swarmdata.evaluation.study.answers.write_answers import QUESTIONS, write_answers
from swarmdata.evaluation.study.plan import Study
from swarmdata.evaluation.study.run_study import StudyOptions, run_study
from tests.evaluation.study.conftest import BC, MADDPG

ROOT = Path(__file__).parents[4]

DIFFERENCES: dict[str, dict[str, object]] = {
    "ingredient": {"title": "Ingredients", "pairs": [["maddpg_bc", "bc"]]},
    "doubling": {"title": "Doubling", "pairs": [["bc-2x", "bc"]], "doubling": True},
    "rewards": {"title": "Safe rewards", "pairs": [["safe", "maddpg_bc"], ["safe", "later"]]},
}


def test_committed_pages_are_what_the_command_writes(tmp_path: Path) -> None:
    """`swarmdata study-pages` writes them."""
    (tmp_path / "cards").mkdir()
    (tmp_path / "cards/studies").symlink_to(ROOT / "cards/studies")
    out, committed = tmp_path / "docs/results", ROOT / "docs/results"
    write_answers(tmp_path / "cards/studies", out)
    assert {file.name for file in out.iterdir()} == {file.name for file in committed.iterdir()}
    for page in sorted(out.glob("*.md")):
        assert page.read_text() == (committed / page.name).read_text(), page.name


@pytest.mark.usefixtures("here")
def test_a_study_answers_what_it_measured(
    make_study: Callable[..., Study], data: Path, tmp_path: Path
) -> None:
    rows = {
        "bc": BC,
        "bc-2x": {**BC, "updates": 2 * BC["updates"]},  # type: ignore[operator]
        "maddpg_bc": MADDPG,
        "safe": {**MADDPG, "rewards": "safe"},
        "later": BC,
    }
    views = {"recorded": {}, "near": {"observation": "state-1"}}
    seen = {"datasets": [str(data)], "algorithms": ["bc"], "views": views}
    study = make_study(algorithms=rows, differences=DIFFERENCES, information=seen)
    options = StudyOptions(
        tmp_path / "studies/tiny", tmp_path / "work", only="[!l]*", progress=False
    )
    _, (report, *_) = run_study(study, options, "x")
    _check_report(report.read_text())
    out = tmp_path / "results"
    pages, left_out = write_answers(tmp_path / "studies", out)
    assert [page.stem for page in pages[1:]] == [
        question.stem for question in QUESTIONS if question.stem != "data-regimes"
    ]
    assert left_out == {"data-regimes.md": "no study has several datasets on the reserved seeds"}
    texts = {page.stem: page.read_text() for page in pages}
    for stem, text in texts.items():
        assert stem == "README" or "Without results: `later/coop_nav-tiny-v0`." in text
    assert "The critic of `maddpg_bc`, on coop_nav-tiny-v0: return " in texts["ingredients"]
    assert "Cloning: " in texts["training-length"]
    assert "with `near` instead of `recorded`: return " in texts["information"]
    assert "`safe` − `maddpg_bc` on coop_nav-tiny-v0: return " in texts["safety"]
    assert "Not compared yet: `safe` − `later`" in texts["safety"]
    assert "return minus that of the clone" in texts["distance-from-data"]
    assert "- Which algorithm for which data? No study with several" in texts["README"]
    assert {file.name for file in out.glob("*.png")} == {
        "ingredients.png", "training-length.png", "information.png", "safety-tiny.png",
        "distance-from-data-tiny.png",
    }  # fmt: skip


def _check_report(text: str) -> None:
    """The sections that the study asks for, with what is missing."""
    for plan in DIFFERENCES.values():
        assert f"\n## {plan['title']}\n" in text
    assert "| `bc-2x` − `bc` | coop_nav-tiny-v0 | " in text
    assert (
        "- Not compared yet: `safe` − `later` on coop_nav-tiny-v0 (no results of `later`)." in text
    )
    assert "(safety.png)" in text


def test_a_page_without_an_answer_goes_and_a_folder_without_studies_is_refused(
    tmp_path: Path,
) -> None:
    out = tmp_path / "results"
    out.mkdir()
    (out / "training-length.md").write_text("of a study that is gone")
    (tmp_path / "studies").mkdir()
    shutil.copytree(ROOT / "cards/studies/validation-medium", tmp_path / "studies/one")
    (tmp_path / "studies/two").mkdir()
    (tmp_path / "studies/two/study.yaml").write_text("not read")
    _, left_out = write_answers(tmp_path / "studies", out)
    assert not (out / "training-length.md").exists()
    assert left_out["study two"] == "it has no cells.tar.xz, so its episodes are not known"
    with pytest.raises(StudyError, match=r"no folder of a study with study\.yaml and cells"):
        write_answers(tmp_path / "results", out)
