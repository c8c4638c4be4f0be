"""The wheel holds the package, all of it, and nothing beside it."""

import subprocess
import sys
import tarfile
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


def test_data_files_of_the_package_are_inside(wheel_names: set[str]) -> None:
    patterns = ("online_algos/configs/*.yaml", "behavior_policies/checkpoints/*", "cards/*.json")
    expected = {f"swarmdata/{p.relative_to(ROOT)}" for each in patterns for p in ROOT.glob(each)}
    assets = (ROOT / "swarmdata/catalogue/assets").iterdir()
    expected |= {str(path.relative_to(ROOT)) for path in assets}

    assert "swarmdata/online_algos/configs/coop_nav-expert.yaml" in expected
    assert "swarmdata/catalogue/assets/catalogue.css" in expected
    assert expected <= wheel_names


def test_the_source_archive_makes_the_same_wheel(
    wheel_names: set[str], tmp_path_factory: pytest.TempPathFactory
) -> None:
    out = tmp_path_factory.mktemp("sdist")
    command = [sys.executable, "-m", "hatchling", "build", "-t", "sdist", "-d", str(out)]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    (archive,) = out.glob("*.tar.gz")
    with tarfile.open(archive) as file:
        inside = {name.partition("/")[2] for name in file.getnames()}

    files = {name.removeprefix("swarmdata/") for name in wheel_names if ".dist-info/" not in name}
    assert {name for name in files if name.split("/")[0] in FOLDERS} <= inside


def test_no_compiled_file_is_inside(wheel_names: set[str]) -> None:
    assert "swarmdata/py.typed" in wheel_names
    assert not [name for name in wheel_names if name.endswith((".pyc", ".nbi", ".nbc"))]
