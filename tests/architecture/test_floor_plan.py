"""The floor plan: where modules go, which deserve a file, and one meaning for each name."""

import ast
import re
import tomllib
from collections import Counter
from collections.abc import Container
from pathlib import Path

import pytest

import swarmdata
from tests.support.package_sources import FOLDERS, ROOT, sources, trees

LOOSE = {"__init__.py", "__main__.py", "errors.py", "interfaces.py", "types.py"}
LINES_OF_A_THOUGHT = 80
COMMANDS = "swarmdata.cli."  # modules that the command line registers
FOLDERS_IN_THE_PACKAGE = 20

SAME_MEANING = {"vdn", "qmix"}
"""Names of two modules each that do mean the same: an algorithm, offline and online."""

SMALL_AND_ALONE = [
    "swarmdata.catalogue.pages.card_html",
    "swarmdata.catalogue.replays.episode_choice",
    "swarmdata.envs.physics.kinematic",
    "swarmdata.registry.ablations",
    "swarmdata.rollouts.spec_check",
]
"""Modules that should be merged into their only importer; the list only becomes shorter."""

SUITES = {
    "architecture", "benchmarks", "contract", "docs", "examples", "faults", "golden", "support",
}  # fmt: skip
"""Folders of tests that mirror no folder of the package."""


def test_only_five_modules_are_loose() -> None:
    assert {path.name for path in sources() if path.parent == Path("swarmdata")} == LOOSE


def test_the_package_has_few_folders() -> None:
    inner = {path.parts[1] for path in sources() if path.parts[0] == "swarmdata"} - LOOSE
    assert len(inner) <= FOLDERS_IN_THE_PACKAGE


def dotted(path: Path) -> str:
    """The name that a module is imported by; of a package, that of its folder."""
    parts = path.with_suffix("").parts
    parts = parts[:-1] if parts[-1] == "__init__" else parts
    return ".".join(parts if parts[0] == "swarmdata" else ("swarmdata", *parts))


def imported(tree: ast.Module, exported: dict[str, str], known: Container[str]) -> set[str]:
    """Modules that one imports; of a name that a package exports, the one that defines it."""
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module:
            names = [f"{node.module}.{alias.name}" for alias in node.names]
            found |= {exported.get(each, each) for each in names} | {node.module}
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
    return {each for each in found if each in known}


def small_and_alone() -> list[str]:
    """Modules of few lines that a single other module imports, and no table names."""
    parsed = {dotted(path): tree for path, tree in trees().items()}
    packages = {dotted(path) for path in sources() if path.name == "__init__.py"}
    exported = {
        f"{package}.{alias.asname or alias.name}": node.module
        for package in packages
        for node in parsed[package].body
        if isinstance(node, ast.ImportFrom) and node.module
        for alias in node.names
    }
    importers = Counter(
        each
        for name, tree in parsed.items()
        for each in imported(tree, exported, parsed)
        if name not in packages and each != name
    )
    named = {
        name
        for text in sources().values()
        for name in re.findall(r"""["'](swarmdata(?:\.\w+)+)(?::\w+)?["']""", text)
    }
    small = {
        dotted(path)
        for path, text in sources().items()
        if len(text.splitlines()) < LINES_OF_A_THOUGHT
        and path.name not in LOOSE
        and "__main__" not in text
    }
    alone = {each for each in small if importers[each] < 2 and not each.startswith(COMMANDS)}
    return sorted(alone - named - set(vars(swarmdata)["_HOMES"].values()))


def test_small_modules_have_two_importers_or_are_registered() -> None:
    assert small_and_alone() == SMALL_AND_ALONE


def test_a_module_name_means_one_thing() -> None:
    counts = Counter(path.stem for path in sources() if path.name != "__init__.py")
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
    for path in sources():
        if path.parts[0] == folder:
            assert (ROOT / path.parent / "__init__.py").exists(), path
