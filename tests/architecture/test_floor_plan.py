"""The floor plan: where modules go, which deserve a file, and one meaning for each name."""

import re
import tomllib
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest

import swarmdata
from tests.support.package_sources import FOLDERS, ROOT, sources

LOOSE = {"__init__.py", "__main__.py", "errors.py", "interfaces.py", "types.py"}
LINES_OF_A_THOUGHT = 80
COMMANDS = "swarmdata.cli."  # modules that the command line registers
FOLDERS_IN_THE_PACKAGE = 20

SAME_MEANING = {"vdn", "qmix"}
"""Names of two modules each that do mean the same: an algorithm, offline and online."""

SMALL_AND_ALONE = [
    "swarmdata.envs.physics.kinematic",
    "swarmdata.rollouts.spec_check",
]
"""Modules that should be merged into their only importer; the list only becomes shorter."""

FROM = re.compile(r"^[ \t]*from (swarmdata[\w.]*) import (\([^)]*\)|[^\n#]*)", re.MULTILINE)
IMPORT = re.compile(r"^[ \t]*import (swarmdata[\w.]*)", re.MULTILINE)

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


def imports(text: str) -> Iterator[tuple[str, dict[str, str]]]:
    """Modules of the package that a module imports, and its names for what it takes from each."""
    for module, names in FROM.findall(text):
        pairs = (each.split() for each in names.strip("()").split(",") if each.strip())
        yield module, {pair[-1]: pair[0] for pair in pairs}
    for module in IMPORT.findall(text):
        yield module, {}


def small_and_alone() -> list[str]:
    """Modules of few lines that a single other module imports, and no table names."""
    texts = {dotted(path): text for path, text in sources().items()}
    packages = {dotted(path) for path in sources() if path.name == "__init__.py"}
    exported = {
        f"{package}.{name}": module
        for package in packages
        for module, names in imports(texts[package])
        for name in names
    }
    importers: Counter[str] = Counter()
    for name, text in texts.items():
        if name not in packages:
            taken = {m: [f"{m}.{each}" for each in names.values()] for m, names in imports(text)}
            found = {exported.get(each, each) for names in taken.values() for each in names}
            importers.update((found | taken.keys()) - {name})
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
