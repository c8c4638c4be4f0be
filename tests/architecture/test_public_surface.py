"""The public names, and what importing them costs."""

import re

import pytest

import swarmdata
from swarmdata.runtime.own_components import GROUPS
from tests.support.interpreter import python
from tests.support.package_sources import FOLDERS, ROOT

HEAVY = ("torch", "zarr", "h5py", "pymunk", "numba", "pydantic", "pettingzoo", "numpy", "typer")


def test_all_is_sorted_and_complete() -> None:
    assert swarmdata.__all__ == sorted(swarmdata.__all__)
    assert dir(swarmdata) == sorted([*swarmdata.__all__, "__version__"])


@pytest.mark.parametrize("name", swarmdata.__all__)
def test_public_name_resolves_and_is_documented(name: str) -> None:
    try:
        assert getattr(swarmdata, name).__doc__
    except ModuleNotFoundError as error:
        if error.name != "torch":
            raise
        pytest.skip(f"swarmdata.{name} needs the torch extra")


def test_no_public_name_is_shadowed_by_a_submodule() -> None:
    modules = {path.stem for path in (ROOT / "swarmdata").iterdir()}

    assert not modules & set(swarmdata.__all__), "importing the module would replace the name"


def test_documents_use_public_names_only() -> None:
    pages = [
        ROOT / "README.md",
        *(ROOT / "docs").rglob("*.md"),
        *(ROOT / "tests/examples").glob("[a-s]*.py"),
    ]
    # swarmdata.json is a file, swarmdata.tasks and so on are groups of entry points
    public = {*swarmdata.__all__, *GROUPS, "__version__", "errors", "json"}
    subclassed = {"envs", "specs", "types"}  # of the task whose rules the tutorial changes
    for page in pages:
        allowed = public | subclassed if page.name == "own-task.md" else public
        for name in re.findall(
            r"\bswarmdata\.([a-z_A-Z]+)\b(?!/)", page.read_text(encoding="utf-8")
        ):
            assert name in allowed, f"{page.name} uses swarmdata.{name}, which is not public"


def test_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'laod'"):
        _ = swarmdata.laod  # type: ignore[attr-defined]


def test_import_loads_nothing_heavy() -> None:
    loaded = python("-c", "import sys, swarmdata; print('\\n'.join(sys.modules))").stdout.split()
    assert "swarmdata" in loaded
    assert not set(HEAVY) & set(loaded)


@pytest.mark.parametrize("folder", FOLDERS[1:])
def test_top_level_folder_refuses_to_be_imported_by_its_short_name(folder: str) -> None:
    result = python("-c", f"import {folder}", cwd=ROOT, check=False)
    assert result.returncode == 1
    assert f"ImportError: import swarmdata.{folder}, not {folder}" in result.stderr
