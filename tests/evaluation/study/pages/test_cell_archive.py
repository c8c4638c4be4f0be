"""Archives of committed studies: their conditions are what the plans' names mean today."""

import json
import tarfile
from pathlib import Path

import pytest

from swarmdata.evaluation.study.cells.cells import Cell
from swarmdata.registry.presets import find_spec
from swarmdata.registry.recipes import find_recipe
from swarmdata.specs.model_choice import with_models
from swarmdata.specs.task_spec import TaskSpec

STUDIES = Path(__file__).parents[4] / "cards/studies"


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
