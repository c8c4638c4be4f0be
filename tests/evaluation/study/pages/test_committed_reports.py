"""Committed studies: pages are what their episodes give, names of views what was evaluated."""

import json
import shutil
import tarfile
from pathlib import Path

import pytest

from swarmdata.evaluation.study.cells.cells import Cell
from swarmdata.evaluation.study.pages.study_folder import rewrite_pages
from swarmdata.registry.presets import find_spec
from swarmdata.registry.recipes import find_recipe
from swarmdata.specs.model_choice import with_models
from swarmdata.specs.task_spec import TaskSpec
from tests.support.pairs import slow

STUDIES = Path(__file__).parents[4] / "cards/studies"
ALL = {plan.parent.name for plan in STUDIES.glob("*/study.yaml")}
TABLES = ("report.md", "estimates.csv", "differences.csv", "views.csv")
HIGHEST = 1200  # pixels: a screen


@pytest.mark.usefixtures("empty_figures")
@pytest.mark.parametrize("name", ["noise", "safe", *slow(*sorted(ALL - {"noise", "safe"}))])
def test_a_committed_report_is_what_its_episodes_give(name: str, tmp_path: Path) -> None:
    study, again = STUDIES / name, Path(shutil.copytree(STUDIES / name, tmp_path / name))
    present = [file for file in TABLES if (study / file).exists()]
    for file in present[1:]:
        (again / file).unlink()
    rewrite_pages(again)
    for file in present:
        assert (again / file).read_text() == (study / file).read_text()


def test_a_committed_figure_is_no_higher_than_a_screen() -> None:
    for file in sorted(STUDIES.glob("**/*.png")):
        header = file.read_bytes()[:24]
        assert int.from_bytes(header[20:24], "big") <= HIGHEST, file


def cells_and_specs(archive: Path) -> list[tuple[Cell, TaskSpec]]:
    """The cells that learned in a view, and the spec of their first policy's results."""
    cells: dict[str, Cell] = {}
    specs: dict[str, TaskSpec] = {}
    with tarfile.open(archive) as members:
        for member in members:
            folder, _, file = member.name.rpartition("/")
            content = members.extractfile(member)
            if content is None or not file.endswith(("cell.json", "-0.json")):
                continue
            document = json.load(content)
            if file == "cell.json":
                cells[folder] = Cell.parse(document)
            elif "spec" in document:
                specs[folder.removesuffix("/results")] = TaskSpec.parse(document["spec"])
    return [
        (cell, specs[name])
        for name, cell in cells.items()
        if cell.observation or cell.communication
    ]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("study", "n_cells"),
    [("hearing", 6), ("information", 140), ("information-online", 24), ("robustness", 20)],
)
def test_names_of_views_mean_what_was_evaluated(study: str, n_cells: int) -> None:
    found = cells_and_specs(STUDIES / study / "cells.tar.xz")
    for cell, spec in found:
        own = find_spec(cell.source) if cell.kind == "online" else find_recipe(cell.source).spec
        assert with_models(own, cell.observation, cell.communication) == spec, cell.name
    assert len(found) == n_cells
