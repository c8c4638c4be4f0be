"""The folder of a study: every table and figure that was asked for, from what the cells found."""

import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import swarmdata
from swarmdata.cards.committed_studies import read_studies
from swarmdata.cards.sections.baselines import baselines_section
from swarmdata.errors import DiskFullError, StudyError
from swarmdata.evaluation.results.result_files import load_result
from swarmdata.evaluation.runs.portable_names import without_places
from swarmdata.evaluation.study.cells import cell_worker
from swarmdata.evaluation.study.cells.cells import RESULTS_FOLDER
from swarmdata.evaluation.study.pages.study_folder import MADE, page_with, rewrite_pages
from swarmdata.evaluation.study.plan import Study
from swarmdata.evaluation.study.run_study import StudyOptions, run_study
from tests.evaluation.study.conftest import BC, MADDPG, Make, options_in, work_here
from tests.support.measured import csv_rows

pytestmark = pytest.mark.usefixtures("here")

GOALS = Path(__file__).parents[4] / "cards/studies/goals"
WHOLE = {"algorithms": {"bc": BC, "maddpg": MADDPG}, "curves": {"points": 2, "episodes": 2}}


@pytest.fixture(scope="module")
def study(data: Path, make_study: Make) -> Study:
    return make_study(
        **WHOLE,
        sizes={"datasets": [str(data)], "algorithms": ["bc"], "sizes": ["full", 200]},
        losses={
            "q": {"column": "q", "label": "mean Q", "datasets": [str(data)],
                  "algorithms": ["maddpg"]},
        },
    )  # fmt: skip


@pytest.fixture(scope="module")
def finished(study: Study, tmp_path_factory: pytest.TempPathFactory) -> StudyOptions:
    """Where the study was run, once."""
    folder = tmp_path_factory.mktemp("finished")
    options = options_in(folder)
    with pytest.MonkeyPatch.context() as patch:
        work_here(patch)
        failures, _ = run_study(study, options, "swarmdata study tiny.yaml")
    assert failures == {}
    return options


def rows(file: Path) -> list[dict[str, str]]:
    return csv_rows(file.read_text())


@pytest.mark.slow
def test_everything_is_written_and_again_the_same(study: Study, finished: StudyOptions) -> None:
    before = (finished.out / "report.md").read_text()
    failures, files = run_study(study, finished, "swarmdata study tiny.yaml")
    assert failures == {}
    assert files[0] == finished.out / "report.md"
    assert sorted(file.name for file in files) == [
        "cells.tar.xz", "collisions.pdf", "collisions.png", "costs.csv", "curves.csv",
        "curves.pdf", "curves.png", "data.csv", "estimates.csv", "losses-q.pdf", "losses-q.png",
        "report.md", "results.csv", "safety.pdf", "safety.png", "scores.pdf", "scores.png",
        "sizes.pdf", "sizes.png", "study.yaml",
    ]  # fmt: skip
    page = files[0].read_text()
    assert "swarmdata study tiny.yaml" in page
    assert "95 % intervals for new training seeds and new episodes" in page
    assert re.search(
        r"\| `bc` \| 20 \| 128 \| 8 \| [\d.]+ to [\d.]+ \|", page
    )  # updates, batch, width, epochs
    for title in ("Protocol", "Return", "Success", "Data efficiency", "Mean Q", "Cost"):
        assert f"\n## {title}" in page
    assert page == before
    _check_tables(finished.out.parent)
    public = without_places(study.model_dump(mode="json"))
    assert Study.from_file(finished.out / "study.yaml") == Study.parse(public)


def test_the_core_has_aggregates_of_its_datasets_alone(tmp_path: Path) -> None:
    """The mean over the core is that of the means of its datasets, of the rows that are on all."""
    folder = Path(shutil.copytree(GOALS, tmp_path / "goals"))
    core = ["coop_nav-medium-replay", "coop_nav-medium"]
    changed = Study.from_file(folder / "study.yaml").model_copy(update={"core": tuple(core)})
    (folder / "study.yaml").write_text(changed.to_yaml())
    page = rewrite_pages(folder)[0].read_text().partition("## The core: 2 rows on 2 datasets")[2]
    assert {"core.png", "core.pdf"} <= {file.name for file in folder.iterdir()}
    core_means: dict[str, float] = {}
    for label in ("bc", "maddpg_bc"):
        means = [
            float(row["mean"])
            for row in rows(folder / "estimates.csv")
            if (row["label"], row["quantity"]) == (label, "score")
            and row["dataset"].removesuffix("-v1") in core
        ]
        assert f"| {label} | 5 | {np.mean(means):.1f} [" in page
        core_means[label] = float(np.mean(means))
    table = {(row["label"], row["minus"]): float(row["mean"]) for row in rows(folder / "core.csv")}
    assert table["bc", ""] == pytest.approx(core_means["bc"])
    difference = core_means["bc"] - core_means["maddpg_bc"]
    assert table["bc", "maddpg_bc"] == pytest.approx(difference) == -table["maddpg_bc", "bc"]
    (improves,) = (
        float(row["probability_of_improvement"])
        for row in rows(folder / "core.csv")
        if (row["label"], row["minus"]) == ("maddpg_bc", "bc")
    )
    assert improves == 1.0


def test_what_the_plan_no_longer_asks_for_goes(
    study: Study, finished: StudyOptions, tmp_path: Path
) -> None:
    options = replace(finished, out=shutil.copytree(finished.out, tmp_path / "out"))
    (options.out / "mine.png").touch()
    _, files = run_study(study.model_copy(update={"losses": {}}), options, "x")
    left = {path for path in options.out.iterdir() if path.suffix != ".json"}
    assert left - {*files} == {options.out / "mine.png"}
    assert options.out / "losses-q.png" not in files


@pytest.mark.slow
def test_a_mixture_is_a_dataset_of_its_own(
    data: Path, other_data: Path, make_study: Make, tmp_path: Path
) -> None:
    parts = {str(data): 3, str(other_data): 1}
    views = {"recorded": {}, "lidar": {"observation": "lidar-8"}}
    study = make_study(
        datasets=[str(data), "both"],
        mixtures={"both": parts},
        algorithms={"bc": BC},
        seeds=[0],
        information={"datasets": ["both"], "algorithms": ["bc"], "views": views},
    )
    failures, files = run_study(study, options_in(tmp_path), "swarmdata study")
    assert failures == {}
    found = {run["dataset"]: run for run in rows(tmp_path / "out" / "data.csv")}
    mixed = [name for name in found if "+" in name]
    assert len(mixed) == len(set(mixed)) == 2  # as recorded, and observed again
    assert found[mixed[0]]["return"] == found[mixed[1]]["return"]
    page = files[0].read_text()
    grid = next(name for name in mixed if f"| `{name}` | `both` |" in page)
    assert f"| `{grid}` | `both` | `coop_nav-tiny-v0` | 3 |" in page
    assert f"| `{grid}` | `both` | `coop_nav-other-v0` | 1 |" in page
    runs = rows(tmp_path / "out" / "results.csv")
    assert {run["dataset"] for run in runs} >= {grid, "coop_nav-tiny-v0"}
    assert {run["n_steps"] for run in runs if run["dataset"] == grid} == {found[grid]["n_steps"]}


def _check_tables(folder: Path) -> None:
    """One row a run, with the means of its file; a card shows them."""
    runs = rows(folder / "out" / "results.csv")
    assert [(run["label"], run["dataset"], run["seed"]) for run in runs] == [
        ("bc", "coop_nav-tiny-200-v0", "0"),
        ("bc", "coop_nav-tiny-200-v0", "1"),
        ("bc", "coop_nav-tiny-v0", "0"),
        ("bc", "coop_nav-tiny-v0", "1"),
        ("maddpg", "coop_nav-tiny-v0", "0"),
        ("maddpg", "coop_nav-tiny-v0", "1"),
    ]
    (file, *_) = sorted((folder / "work/cells/maddpg/coop_nav-tiny-v0" / RESULTS_FOLDER).iterdir())
    mean = float(np.mean(load_result(file).evaluation.metrics["return"]))
    assert float(runs[4]["return"]) == pytest.approx(mean)
    assert (runs[4]["updates"], runs[4]["episodes"], runs[4]["score"]) == ("10", "4", "")
    (committed,) = (each for each in read_studies(folder) if each.name == "out")
    section = baselines_section("coop_nav-tiny-v0", runs[4]["digest"], [committed])
    assert section.count("| `bc` |") == 1
    facts = {row["dataset"]: row for row in rows(folder / "out" / "data.csv")}
    assert int(facts["coop_nav-tiny-v0"]["n_steps"]) >= 400
    assert {row["attempts"] for row in rows(folder / "out" / "costs.csv")} == {"1"}


def test_pages_are_made_again_from_the_folder_alone(finished: StudyOptions, tmp_path: Path) -> None:
    moved = Path(shutil.copytree(finished.out, tmp_path / "elsewhere"))
    before = {path.name: path.read_bytes() for path in moved.iterdir()}
    for name in ("report.md", "scores.png", "losses-q.png", "estimates.csv"):
        (moved / name).unlink()
    files = rewrite_pages(moved)
    assert files[0] == moved / "report.md"
    after = {path.name: path.read_bytes() for path in moved.iterdir()}
    assert after == before
    assert {path.name for path in files} >= {"scores.png", "losses-q.png", "estimates.csv"}
    archive = moved / "cells.tar.xz"
    for content in (b"garbage", archive.read_bytes()[:1000]):
        archive.write_bytes(content)
        with pytest.raises(StudyError, match=r"cells\.tar\.xz is damaged .*; restore it, or run"):
            rewrite_pages(moved)
    archive.unlink()
    with pytest.raises(StudyError, match=r"has no cells\.tar\.xz"):
        rewrite_pages(moved)


@pytest.mark.slow
def test_what_failed_is_told_and_nothing_at_all_is_an_error(
    make_study: Make,
    data: Path,
    other_data: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    study = make_study(datasets=[str(data), str(other_data)], algorithms={"bc": BC})
    options = options_in(tmp_path, only="bc/*tiny*")
    _, files = run_study(study, options, "x")
    assert "| bc/coop_nav-other-v0 | not run yet |" in files[0].read_text()
    monkeypatch.setattr(cell_worker, "_evaluate", _run_out_of_space)
    study = make_study(algorithms={"bc": BC})
    empty = replace(options_in(tmp_path), work=tmp_path / "empty")
    with pytest.raises(StudyError, match="no cell on the study's datasets is done"):
        run_study(study, empty, "x")
    error = tmp_path / "empty/cells/bc/coop_nav-tiny-v0/error.txt"
    assert "no space is left" in error.read_text()


def _run_out_of_space(*_: object) -> None:
    raise DiskFullError("no space is left")


@pytest.mark.slow
def test_pairs_and_online_rows_have_sections(make_study: Make, data: Path, tmp_path: Path) -> None:
    task = tmp_path / "nav.yaml"
    task.write_text(swarmdata.load(data).task.to_yaml())
    settings = {"n_copies": 2, "rollout_steps": 16, "minibatch": 32, "n_epochs": 1, "hidden": 8}
    online = {"algorithm": "mappo", "task": str(task), "frames": 64, "settings": settings}
    twice = {**BC, "updates": 40}
    study = make_study(
        algorithms={"bc": BC, "bc-2x": twice, "later": BC},
        seeds=[0],
        online={"learned": online},
        information={"datasets": [str(data)], "algorithms": ["bc"], "online": ["learned"],
                     "views": {"recorded": {}, "near": {"observation": "state-1"}}},
        differences={
            "doubling": {"title": "Doubling", "pairs": [["bc-2x", "bc"]], "doubling": True},
            "more": {"title": "More", "pairs": [["bc-2x", "later"]]},
            "same": {"title": "Cost", "pairs": [["bc-2x", "bc"]]},
        },
    )  # fmt: skip
    options = options_in(tmp_path, only="[!l]*")
    run_study(study, options, "x")
    failures, (report, *_) = run_study(study, replace(options, only="learned/*"), "x")
    assert failures == {}
    assert report.read_text().count("\n## Cost\n") == 2, "a title of the plan hides no section"
    sections = dict(part.split("\n", 1) for part in report.read_text().split("\n## ")[1:])
    assert "| `bc-2x` − `bc` | coop_nav-tiny-v0 | " in sections["Doubling"]
    assert re.search(r"\| coop_nav-tiny-v0 \| cloning \S+ \| cloning \S+ \|", sections["Doubling"])
    assert re.search(r"\| cloning \| (20|–) \| ", sections["Doubling"])
    assert "- `bc-2x` − `later` on coop_nav-tiny-v0 (no results of `later`)" in sections["More"]
    assert "| later/coop_nav-tiny-v0 | not run yet |" in sections["Without results"]
    assert "\n| `learned` | 1 | 64 | " in sections["Online algorithms"]
    curves = sections["Convergence of online training"]
    assert "\n| `learned` | " in curves
    seen = sections["Information: trained and evaluated with it"]
    row = next(line for line in seen.splitlines() if line.startswith("| `learned (online)` |"))
    assert "–" not in row, "an estimate in both views"
    drawn = {path.name for path in report.parent.glob("*.png")}
    assert {"differences-doubling.png", "online-curves.png"} <= drawn
    assert "differences-more.png" not in drawn


def test_only_what_is_made_is_replaced(tmp_path: Path) -> None:
    file = tmp_path / "page.md"
    file.write_text(page_with("first table", file, "Title"))
    assert file.read_text() == f"# Title\n\n{MADE}\n\nfirst table\n"
    file.write_text(file.read_text().replace("# Title\n", "# Title\n\nBy hand.\n"))
    assert page_with("second", file, "Other") == f"# Title\n\nBy hand.\n\n{MADE}\n\nsecond\n"
    file.write_text("By hand alone.\n")
    assert page_with("second", file, "Other") == f"By hand alone.\n\n{MADE}\n\nsecond\n"
