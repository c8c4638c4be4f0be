"""The wheel holds the package, all of it, and nothing beside it."""

import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FOLDERS = ("envs", "behavior_policies", "offline_algos", "online_algos", "cards")


@pytest.fixture(scope="module")
def wheel_names(tmp_path_factory: pytest.TempPathFactory) -> set[str]:
    pytest.importorskip("hatchling", reason="builds the wheel; the dependency group 'test' has it")
    out = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(out)]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    (wheel,) = out.glob("*.whl")
    return set(zipfile.ZipFile(wheel).namelist())


def test_only_the_package_is_at_the_top(wheel_names: set[str]) -> None:
    tops = {name.split("/")[0] for name in wheel_names}

    assert {top for top in tops if not top.endswith(".dist-info")} == {"swarmdata"}


def test_every_source_of_the_five_folders_is_inside(wheel_names: set[str]) -> None:
    sources = [path for folder in FOLDERS for path in (ROOT / folder).rglob("*.py")]
    expected = {f"swarmdata/{path.relative_to(ROOT)}" for path in sources}

    assert len(expected) >= len(FOLDERS)
    assert expected <= wheel_names


def test_no_compiled_file_is_inside(wheel_names: set[str]) -> None:
    assert "swarmdata/py.typed" in wheel_names
    assert not [name for name in wheel_names if name.endswith((".pyc", ".nbi", ".nbc"))]
