"""The floor plan: where modules go, how many share a folder, and one meaning for each name."""

import tomllib
from collections import Counter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FOLDERS = ("swarmdata", "envs", "behavior_policies", "offline_algos", "online_algos", "cards")
LOOSE = {"__init__.py", "__main__.py", "errors.py", "interfaces.py", "types.py"}
MODULES_IN_A_FOLDER = 16
FOLDERS_IN_THE_PACKAGE = 20

SAME_MEANING = {"vdn", "qmix"}
"""Names of two modules each that do mean the same: an algorithm, offline and online."""

SUITES = {
    "architecture", "benchmarks", "contract", "docs", "examples", "faults", "golden", "support",
}  # fmt: skip
"""Folders of tests that mirror no folder of the package."""


def modules() -> list[Path]:
    """Every module of the package, by its path in the repository."""
    return [
        path.relative_to(ROOT)
        for folder in FOLDERS
        for path in sorted((ROOT / folder).rglob("*.py"))
        if not any(parent.is_symlink() for parent in path.parents)
    ]


def test_only_five_modules_are_loose() -> None:
    assert {path.name for path in modules() if path.parent == Path("swarmdata")} == LOOSE


def test_the_package_has_few_folders() -> None:
    inner = {path.parts[1] for path in modules() if path.parts[0] == "swarmdata"} - LOOSE
    assert len(inner) <= FOLDERS_IN_THE_PACKAGE


def test_folders_hold_few_modules() -> None:
    counts = Counter(path.parent for path in modules() if path.name != "__init__.py")
    assert {str(f): n for f, n in counts.items() if n > MODULES_IN_A_FOLDER} == {}


def test_a_module_name_means_one_thing() -> None:
    counts = Counter(path.stem for path in modules() if path.name != "__init__.py")
    assert {name for name, n in counts.items() if n > 1} == SAME_MEANING


def test_layers_name_folders() -> None:
    with (ROOT / "pyproject.toml").open("rb") as file:
        contracts = tomllib.load(file)["tool"]["importlinter"]["contracts"]
    layers: list[str] = next(each for each in contracts if each["type"] == "layers")["layers"]
    names = [name for layer in layers for name in layer.replace("|", ":").split(":")]

    for name in (name.strip().replace(".", "/") for name in names):
        assert (ROOT / name).is_dir() or Path(name).name + ".py" in LOOSE, name


def test_tests_mirror_the_tree() -> None:
    assert [path.name for path in (ROOT / "tests").glob("*.py")] == ["conftest.py"]
    for path in (ROOT / "tests").rglob("test_*.py"):
        folder = path.parent.relative_to(ROOT / "tests")
        if folder.parts[0] not in SUITES:
            assert (ROOT / "swarmdata" / folder).is_dir(), path


@pytest.mark.parametrize("folder", FOLDERS)
def test_every_folder_says_what_it_is(folder: str) -> None:
    for path in modules():
        if path.parts[0] == folder:
            assert (ROOT / path.parent / "__init__.py").exists(), path
