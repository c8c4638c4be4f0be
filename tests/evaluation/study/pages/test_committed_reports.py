"""Committed studies: pages are what their episodes give, names of views what was evaluated."""

import json
import shutil
import tarfile
from functools import cache
from pathlib import Path
from typing import IO

import pytest

from swarmdata.evaluation.study.cells.cells import Cell, cells_of
from swarmdata.evaluation.study.cells.study_data import digest_of
from swarmdata.evaluation.study.pages.study_folder import rewrite_pages
from swarmdata.evaluation.study.plan import Study
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


CURRENT = ("blind", "messages", "regimes", "robotarium", "sides", "swap", "teams", "weights")
"""Studies whose numbers today's code gives: their settings have not changed since."""


@pytest.mark.parametrize("name", CURRENT)
def test_no_new_setting_makes_the_cells_of_a_current_study_stale(name: str) -> None:
    planned = cells_of(Study.from_file(STUDIES / f"{name}.yaml"), cache(digest_of))
    keys = {cell.name: cell.key for cell in planned}
    with tarfile.open(STUDIES / name / "cells.tar.xz") as members:
        files = (member for member in members if member.name.endswith("/cell.json"))
        stored = [Cell.parse(json.load(opened(members, file))) for file in files]
    assert {cell.name: cell.key for cell in stored}.items() <= keys.items()


def opened(members: tarfile.TarFile, file: tarfile.TarInfo) -> IO[bytes]:
    content = members.extractfile(file)
    assert content is not None
    return content


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
