"""Presets and files become specs; everything else is explained."""

from pathlib import Path

import pytest

from swarmdata.errors import SpecError, UnknownNameError
from swarmdata.registry.components import TASKS
from swarmdata.registry.presets import find_spec, name_of, preset, preset_names, preset_summary
from swarmdata.specs.task_spec import TaskSpec


@pytest.mark.parametrize("name", preset_names())
def test_every_preset_is_a_spec_with_a_line_about_it(name: str) -> None:
    assert find_spec(name) == preset(name)
    assert preset(name).task in TASKS
    assert len(preset_summary(name)) > 10
    assert preset_summary(name).endswith(".")  # a whole sentence, also over two lines
    assert TaskSpec.from_text(preset(name).to_yaml()) == preset(name)
    assert name_of(preset(name)) == name


def test_a_spec_of_no_preset_has_its_tasks_name() -> None:
    assert name_of(TaskSpec(horizon=21)) == "coop_nav"


def test_files_are_specs(tmp_path: Path) -> None:
    for suffix, text in ((".yaml", TaskSpec(horizon=50).to_yaml()), (".json", '{"horizon": 50}')):
        file = tmp_path / f"mine{suffix}"
        file.write_text(text)
        assert find_spec(str(file)) == TaskSpec(horizon=50)


def test_unknown_names_and_files_are_explained(tmp_path: Path) -> None:
    with pytest.raises(UnknownNameError, match="Did you mean 'coop_nav'"):
        find_spec("coop_nv")
    with pytest.raises(UnknownNameError):
        preset_summary("coop_nv")
    with pytest.raises(
        SpecError, match=r"cannot read a spec from .*none\.yaml.*presets .*coop_nav"
    ):
        find_spec(str(tmp_path / "none.yaml"))
    (tmp_path / "binary.yaml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(SpecError, match=r"binary\.yaml is not UTF-8"):
        find_spec(str(tmp_path / "binary.yaml"))
    (tmp_path / "bad.yaml").write_text("horizn: 5")
    with pytest.raises(SpecError, match="Did you mean 'horizon'"):
        find_spec(str(tmp_path / "bad.yaml"))
