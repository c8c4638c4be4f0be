"""What the first `load` of a cached dataset, a list and an `info` import: no compiled code."""

import json
from dataclasses import asdict
from pathlib import Path

import pytest

from swarmdata.store import open_store
from swarmdata.store.publication import publication
from swarmdata.testing.synthetic import write_release
from tests.support.interpreter import python
from tests.support.pairs import slow

MOST_MODULES = 61
"""Modules of ours for a dataset of one task; those of the command line come on top."""

FOR_YAML = 1
"""That which reads the preset."""

HEAVY = {"numba", "zarr", "h5py", "pymunk", "torch", "yaml"}
"""Packages that take longer to import than a load should."""

REPORT = (
    "import sys, json; print(json.dumps(sorted("
    "name for name in sys.modules if '.' not in name or name.startswith('swarmdata.'))))"
)

PUBLISH = (
    "import json; from pathlib import Path; from swarmdata.hub.catalog import identity;"
    "from swarmdata.registry.published import Published;"
    "entry = Published.parse(json.loads(Path({entry!r}).read_text()));"
    "identity.published = lambda: {{'coop_nav-own-v0': entry}};"
)

USES = {
    "load": PUBLISH + "import swarmdata; next(swarmdata.load('coop_nav-own-v0').sampler())",
    "list command": "from swarmdata.cli.main import app; app(['list'], standalone_mode=False)",
    "list": "import swarmdata; assert len(swarmdata.list_datasets()) > 100",
    "info": "from swarmdata.cli.main import app;"
    "app(['info', 'coop_nav-medium-mini'], standalone_mode=False)",
}


def test_a_list_of_published_datasets_imports_no_numpy(cache_folder: Path) -> None:
    assert not {*HEAVY, "numpy", "pydantic"} & set(imported_by(USES["list command"]))


def imported_by(code: str) -> list[str]:
    """Modules that a program imports, but those of other packages' folders."""
    done = python("-W", "ignore", "-c", f"{code}; {REPORT}")
    modules: list[str] = json.loads(done.stdout.splitlines()[-1])
    return modules


@pytest.mark.parametrize("use", [*list(USES)[:2], *slow(*list(USES)[2:])])
def test_what_is_read_imports_little(use: str, tmp_path: Path, cache_folder: Path) -> None:
    folder = cache_folder / "datasets" / "coop_nav-own-v0"
    write_release(folder, [30, 70], "coop_nav-own-v0")
    entry = tmp_path / "entry.json"
    entry.write_text(json.dumps(asdict(publication(open_store(folder)))))
    modules = imported_by(USES[use].format(entry=str(entry)))
    shown = use == "info"  # which writes YAML
    assert HEAVY & set(modules) == ({"yaml"} if shown else set())
    ours = [each for each in modules if each.startswith("swarmdata")]
    of_library = [each for each in ours if not each.startswith("swarmdata.cli")]
    assert len(of_library) <= MOST_MODULES + shown * FOR_YAML, of_library
