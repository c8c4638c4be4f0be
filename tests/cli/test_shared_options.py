"""Options of several commands: models by name modify the task's own, and every command says how."""

from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from swarmdata.cli.main import app
from swarmdata.registry.presets import preset
from swarmdata.specs.recipe import PolicySource
from tests.catalogue.conftest import little_published
from tests.cli.test_option_use import COMMANDS, Reached
from tests.support.pairs import slow
from tests.support.tiny import make_tiny

MODELS = ("--observation", "noise-0.02", "--communication", "lossy-30")

SAID = (
    "Changes to the task's own models: observation.noise.position 0 -> 0.02, "
    "observation.noise.velocity 0 -> 0.02, observation.noise.direction 0 -> 0.02, "
    "observation.noise.range 0 -> 0.02, communication.drop_probability 0 -> 0.3"
)

LINES = (
    "task show search",
    "task play search --policy idle --out {out}/a.png",
    "render idle --task search --out {out}/a.png",
    "evaluate idle --task search --episodes 1",
    "generate --task search --policy idle --id search-b-v0 --steps 300 --workers 1 --out {out}/b",
    "train bc {data} --out {out}/run",
    "train-online mappo search --out {out}/run",
    "catalogue build {data} --episodes 1 --out {out}/site",
)
OTHER_SOURCES = ("render {data} --out {out}/a.png", "evaluate {data} --episodes 1")


BOUNDARIES = (
    "swarmdata.evaluation.runs.generated_dataset.build",
    "swarmdata.evaluation.runs.train.train_seeds",
    "swarmdata.evaluation.runs.train.train_run",
)
"""Functions that do the work which follows, and end the command here."""


def reach(*_: Any, **__: Any) -> None:
    raise Reached


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("data") / "search-a-v0"
    idle = (PolicySource(label="idle", name="idle"),)
    return make_tiny(folder, id="search-a-v0", spec=preset("search"), policies=idle)


def test_every_command_that_takes_models_is_in_the_table() -> None:
    taking = {
        name
        for name, command in COMMANDS.items()
        if {"observation", "communication"} <= {each.name for each in command.params}
    }
    shown = {name for name in taking for line in LINES if f"{line} ".startswith(f"{name} ")}
    assert shown == taking - {"sweep"}, "whose options are axes"


@pytest.mark.parametrize("line", [*LINES, *slow(*OTHER_SOURCES)])
def test_a_command_names_every_field_that_its_models_change_once(
    line: str, data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if line.startswith("train"):
        pytest.importorskip("torch", reason="training needs the torch extra")
    for boundary in BOUNDARIES:
        if "train" not in boundary or line.startswith("train"):
            monkeypatch.setattr(boundary, reach)
    words = line.format(data=data, out=tmp_path).split()
    with little_published():
        result = CliRunner().invoke(app, [*words, *MODELS])
    assert result.exit_code == 0 or isinstance(result.exception, Reached), result.output
    assert result.stderr.splitlines().count(SAID) == 1, result.output
    assert SAID not in result.stdout
