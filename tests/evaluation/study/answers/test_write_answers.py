"""Pages of answers: the committed ones are current, and a study gets every page it can answer."""

import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

pytest.importorskip("torch", reason="a study needs the torch extra")
pytest.importorskip("matplotlib", reason="figures need the plots extra")

from swarmdata.errors import StudyError
from swarmdata.evaluation.study.answers import write_answers as write_answers_module
from swarmdata.evaluation.study.answers.write_answers import (
    ANSWERS,
    OTHER_PAGES,
    QUESTIONS,
    write_answers,
)
from swarmdata.evaluation.study.plan import Study
from swarmdata.evaluation.study.run_study import StudyOptions, all_cells, run_study
from swarmdata.runtime.output_folder import filled
from tests.evaluation.study.conftest import BC, MADDPG

ROOT = Path(__file__).parents[4]

DIFFERENCES: dict[str, dict[str, object]] = {
    "ingredient": {"title": "Ingredients", "pairs": [["maddpg_bc", "bc"]]},
    "doubling": {
        "title": "Doubling",
        "pairs": [["bc-2x", "bc"], ["maddpg_bc-2x", "maddpg_bc"]],
        "doubling": True,
    },
    "rewards": {"title": "Safe rewards", "pairs": [["safe", "maddpg_bc"], ["safe", "later"]]},
}

ELSEWHERE = {
    "data-regimes.md": "no study has several datasets on the reserved seeds",
    "online.md": "no study has `online` rows in the task of one of its datasets",
    "robustness.md": "no study has measured `sweeps`",
    "places.md": "no study has policies evaluated in other `tasks`",
    "data-efficiency.md": "no study has measured `sizes`",
}
"""Pages that the study of the second test does not answer, and why."""


@pytest.mark.usefixtures("empty_figures")
def test_committed_pages_are_what_the_command_writes(tmp_path: Path) -> None:
    """`swarmdata study-pages` writes all but those of other commands, and an index of all."""
    (tmp_path / "cards").mkdir()
    (tmp_path / "cards/studies").symlink_to(ROOT / "cards/studies")
    out, committed = tmp_path / "docs/results", ROOT / "docs/results"
    out.mkdir(parents=True)
    for name in (*OTHER_PAGES, ANSWERS.list_file):
        shutil.copy(committed / name, out)
    write_answers(tmp_path / "cards/studies", out)
    written = {file.name for file in out.iterdir() if file.suffix != ".pdf"}  # not committed
    assert written == {file.name for file in committed.iterdir() if file.suffix != ".pdf"}
    for page in sorted(out.glob("*.md")):
        assert page.read_text() == (committed / page.name).read_text(), page.name


@pytest.mark.usefixtures("here")
def test_a_study_answers_what_it_measured(
    make_study: Callable[..., Study], data: Path, tmp_path: Path
) -> None:
    maddpg_bc = {**MADDPG, "updates": BC["updates"]}
    rows = {
        "bc": BC,
        "bc-2x": {**BC, "updates": 2 * BC["updates"]},  # type: ignore[operator]
        "maddpg_bc": maddpg_bc,
        "maddpg_bc-2x": {**maddpg_bc, "updates": 2 * BC["updates"]},  # type: ignore[operator]
        "safe": {**maddpg_bc, "rewards": "safe"},
        "later": BC,
    }
    views = {
        "recorded": {},
        "near": {"observation": "state-1"},
        "noisy": {"observation": "state+noise-0.2"},
    }
    seen = {
        "datasets": [str(data)],
        "algorithms": ["bc"],
        "views": views,
        "transfer": ["bc"],
        "transfer_episodes": 3,
    }
    study = make_study(algorithms=rows, differences=DIFFERENCES, information=seen)
    options = StudyOptions(
        tmp_path / "studies/tiny", tmp_path / "work", only="[!l]*", progress=False
    )
    run_study(study, options, "x")
    _, (report, *_) = run_study(study, replace(options, only=None, shifts_only=True), "x")
    _check_report(report.read_text())
    plain = study.model_copy(update={"name": "plain", "information": None, "differences": {}})
    run_study(plain, replace(options, out=tmp_path / "studies/plain"), "x")
    out = tmp_path / "results"
    pages, left_out = write_answers(tmp_path / "studies", out)
    assert [page.stem for page in pages[1:]] == [
        question.stem for question in QUESTIONS if f"{question.stem}.md" not in ELSEWHERE
    ]
    assert left_out == ELSEWHERE
    texts = {page.stem: page.read_text() for page in pages}
    for stem, text in texts.items():
        assert stem == "README" or "Without results: `later/coop_nav-tiny-v0`." in text
        assert stem == "README" or "\n\n**In short:** " in text
        if stem != "README":
            headline = text.partition("**In short:** ")[2].partition("\n")[0]
            assert f"]({stem}.md) {headline}\n" in texts["README"]
    assert "In 1 comparison, the ingredient clearly raises the return in " in texts["ingredients"]
    assert "The critic of `maddpg_bc`, on coop_nav-tiny-v0: return " in texts["ingredients"]
    n_cells = len({cell.key for cell in all_cells(study) if cell.label != "later"})
    assert f"The studies have {n_cells} different cells" in texts["README"]
    assert "Of the orders of two families, doubling 20 updates" in texts["training-length"]
    assert "Cloning: " in texts["training-length"]
    orders = "Orders of two families on one dataset: of 1, doubling 20 updates leaves "
    assert orders in texts["training-length"]
    assert "| coop_nav-tiny-v0 | " in texts["training-length"].partition("Families by")[2]
    assert (
        "with `near` instead of `recorded`, the return of `bc` changes by" in texts["information"]
    )
    assert "\n| `near` | " in texts["information"]
    assert (
        "On coop_nav-tiny-v0, in 2 pairs of views `bc` solves 0 percentage" in texts["information"]
    )
    assert "`safe` − `maddpg_bc` on coop_nav-tiny-v0: return " in texts["safety"]
    assert "Not compared yet: `safe` − `later`" in texts["safety"]
    assert "return minus that of the clone" in texts["distance-from-data"]
    assert "- Which algorithm for which data? No study with several" in texts["README"]
    assert {file.name for file in out.glob("*.png")} == {
        "ingredients.png", "training-length.png", "information-tiny-coop_nav-tiny-v0.png",
        "information-tiny-coop_nav-tiny-v0-bc-transfer.png",
        "safety-tiny.png", "safety-plain.png", "distance-from-data-plain.png",
    }  # fmt: skip


@pytest.mark.slow
@pytest.mark.usefixtures("here")
def test_other_conditions_places_and_sizes_have_pages(
    make_study: Callable[..., Study], data: Path, tmp_path: Path
) -> None:
    name = str(data)
    sweep = {"dataset": name, "vary": "observation", "axis": "noise=0,0.3", "episodes": 3}
    tasks = {"datasets": [name], "algorithms": ["bc"], "tasks": ["coop_nav-easy", "coop_nav-n8"]}
    study = make_study(
        algorithms={"bc": BC, "maddpg_bc": MADDPG},
        sweeps={"noise": sweep},
        tasks={**tasks, "episodes": 3},
        sizes={"datasets": [name], "algorithms": ["bc", "maddpg_bc"], "sizes": ["full", 120]},
    )
    options = StudyOptions(tmp_path / "studies/tiny", tmp_path / "work", progress=False)
    run_study(study, options, "x")
    out = tmp_path / "results"
    pages, _ = write_answers(tmp_path / "studies", out)
    texts = {page.stem: page.read_text() for page in pages}
    robustness, places, sizes = (
        texts[stem] for stem in ("robustness", "places", "data-efficiency")
    )
    assert "On coop_nav-tiny-v0, observation noise 0.3 changes the return least for `" in robustness
    assert re.search(r"In short:.* value: observation noise 0\.3: \d+ and \d+ %\.\n", robustness)
    assert "[All values](../studies/tiny/sweeps/noise/sweep.csv)" in robustness
    assert "On coop_nav-easy, of policies that learned on coop_nav-tiny-v0, those of " in places
    assert "On coop_nav-n8, no policies that learned on coop_nav-tiny-v0 fit." in places
    assert "With 120 joint steps of coop_nav-tiny-v0, the best return is " in sizes
    assert re.search(r"On coop_nav-tiny-v0, with 120 joint steps instead of \d+, the return", sizes)
    drawn = {file.stem for file in out.glob("*.png")}
    assert {"robustness-tiny", "places-tiny-coop_nav-tiny-v0", "data-efficiency-tiny"} <= drawn


def _check_report(text: str) -> None:
    """The sections that the study asks for, with what is missing."""
    for plan in DIFFERENCES.values():
        assert f"\n## {plan['title']}\n" in text
    assert "| `bc-2x` − `bc` | coop_nav-tiny-v0 | " in text
    assert (
        "- Not compared yet: `safe` − `later` on coop_nav-tiny-v0 (no results of `later`)." in text
    )
    assert "(safety.png)" in text


@pytest.mark.usefixtures("empty_figures")
def test_a_page_without_an_answer_goes_and_a_folder_without_studies_is_refused(
    tmp_path: Path,
) -> None:
    out = tmp_path / "results"
    with filled(out, ANSWERS) as folder:
        (folder / "training-length.md").write_text("of a study that is gone")
    (out / "safety-notes.png").write_text("mine")
    (tmp_path / "studies").mkdir()
    shutil.copytree(ROOT / "cards/studies/validation-medium", tmp_path / "studies/one")
    (tmp_path / "studies/two").mkdir()
    (tmp_path / "studies/two/study.yaml").write_text("not read")
    _, left_out = write_answers(tmp_path / "studies", out)
    assert not (out / "training-length.md").exists()
    assert (out / "safety-notes.png").read_text() == "mine"
    assert left_out["study two"] == "it has no cells.tar.xz, so its episodes are not known"
    with pytest.raises(StudyError, match=r"no folder of a study with study\.yaml and cells"):
        write_answers(tmp_path / "results", tmp_path / "new")


def test_pages_stay_if_an_answer_fails(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise StudyError("the disk is full")

    shutil.copytree(ROOT / "cards/studies/validation-medium", tmp_path / "studies/one")
    out = tmp_path / "results"
    with filled(out, ANSWERS) as folder:
        for question in QUESTIONS:
            (folder / f"{question.stem}.md").write_text("as before")
    before = {file: file.read_text() for file in tmp_path.glob("results*/*")}
    failing = (*QUESTIONS[:-1], replace(QUESTIONS[-1], answer=fail))
    monkeypatch.setattr(write_answers_module, "QUESTIONS", failing)
    with pytest.raises(StudyError, match="the disk is full"):
        write_answers(tmp_path / "studies", out)
    assert {file: file.read_text() for file in tmp_path.glob("results*/*")} == before
    assert {file.name for file in tmp_path.iterdir()} == {"studies", "results"}
