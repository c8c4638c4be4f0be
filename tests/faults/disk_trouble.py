"""Full and read-only disks, for real, in mounts of a process's own.

Each function mounts a small disk at a folder, makes and loads datasets there, and prints one JSON
object of what was seen.
"""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from functools import wraps
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

from swarmdata.building import build as build_module
from swarmdata.building.parts_folder import build_folder
from swarmdata.cards.publish import publish_card
from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import SwarmdataError
from swarmdata.evaluation.results.clips import write_clip
from swarmdata.hub.catalog import request
from swarmdata.hub.catalog.catalog import load
from swarmdata.hub.catalog.repair import examine
from swarmdata.interop.export import export_dataset
from swarmdata.registry.recipes import find_recipe
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.store import read_manifest, write_file
from swarmdata.store.assembly import assemble
from swarmdata.testing.synthetic import make_dataset
from tests.support.interpreter import python
from tests.support.made_episodes import play
from tests.support.namespaces import CLONE_NEWNS, enter
from tests.support.one_process import OneProcessCrew, use_one_process
from tests.support.tiny import TINY, make_tiny

ROOT = Path(__file__).parents[2]


def mount(folder: Path, options: str) -> None:
    command = ["mount", "-t", "tmpfs", "-o", options, "none", str(folder)]
    subprocess.run(command, check=True)


def error_of(work: Callable[[], object]) -> str:
    try:
        work()
    except SwarmdataError as error:
        return f"{type(error).__name__}: {error}"
    return "none"


def seen(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


NO_NAMESPACE = 77
"""Exit code of a process that may not have mounts of its own."""

Work = Callable[..., dict[str, Any]]


def in_namespace(work: Work) -> Callable[..., None]:
    """What a process does that nobody else may see the mounts of."""

    @wraps(work)
    def run(folder: str, *names: str) -> None:
        try:
            enter(CLONE_NEWNS)
        except (OSError, subprocess.CalledProcessError):
            sys.exit(NO_NAMESPACE)
        use_one_process(pytest.MonkeyPatch())
        print(json.dumps(work(Path(folder), *names)))

    return run


@in_namespace
def full(folder: Path) -> dict[str, Any]:
    """The disk fills while a part is written, and while the dataset is put together."""
    out, result = folder / "d", dict[str, Any]()
    mount(folder, "size=48k")
    result["part"] = error_of(lambda: make_tiny(out))
    result["left"] = seen(folder), seen(build_folder(out))
    mount(folder, "remount,size=20m")

    def fill_then_assemble(*arguments: Any, **options: Any) -> Any:
        (folder / "someone elses").write_bytes(b"x" * (20 << 20 >> 1))
        mount(folder, f"remount,size={_used(folder) + (64 << 10)}")
        return assemble(*arguments, **options)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(build_module, "assemble", fill_then_assemble)
        result["assembly"] = error_of(lambda: make_tiny(out))
    result["left after assembly"] = seen(folder)
    (folder / "someone elses").unlink()
    mount(folder, "remount,size=20m")
    OneProcessCrew.made.clear()
    result["digest"] = read_manifest(make_tiny(out)).digest
    result["made again"] = OneProcessCrew.made
    result["damage"] = [str(each) for each in examine(out)]
    result["at the end"] = seen(folder)
    return result


FORMATS = {
    "d4rl": "h5py",
    "d4rl-agents": "h5py",
    "minari": "minari",
    "parquet": "pyarrow",
    "torchrl": "tensordict",
    "vault": "flashbax",
}
"""What is written, and the library that it needs."""


@in_namespace
def exports(folder: Path, *names: str) -> dict[str, Any]:
    """Files that we make for others, on a disk that is too small and then on a larger one."""
    make_dataset(folder.parent / "source", [[100] * 60])
    dataset = Dataset.open(folder.parent / "source")
    spec = TaskSpec(horizon=20)
    (episode,) = play(spec, 1, "random")
    makers: dict[str, Callable[[Path], object]] = {
        name: lambda out, name=name: export_dataset(dataset, out / "x", format=name)  # type: ignore[misc]
        for name in names
        if find_spec(FORMATS[name])
    }
    makers["card"] = lambda out: publish_card(folder.parent / "tiny", out)
    makers["clip"] = lambda out: write_clip(episode, spec, out / "x.gif")
    make_tiny(folder.parent / "tiny")
    mount(folder, "size=20m")
    return {name: _on_a_full_disk(folder / name, make) for name, make in makers.items()}


def _on_a_full_disk(out: Path, make: Callable[[Path], object]) -> dict[str, Any]:
    out.mkdir()
    mount(out, "size=4k")
    small = error_of(lambda: make(out)), seen(out)
    mount(out, "remount,size=200k")
    middle = error_of(lambda: make(out)), seen(out)
    mount(out, "remount,size=40m")
    return {"small": small, "middle": middle, "large": (error_of(lambda: make(out)), seen(out))}


@in_namespace
def inodes(folder: Path) -> dict[str, Any]:
    """No file can be made, though there is space; then a few can."""
    mount(folder, "size=20m,nr_inodes=1")
    result = {"file": error_of(lambda: write_file(folder / "x", b"x"))}
    mount(folder, "remount,size=20m,nr_inodes=12")
    result["build"] = error_of(lambda: make_tiny(folder / "d"))
    mount(folder, "remount,size=20m,nr_inodes=500")
    result["again"] = error_of(lambda: make_tiny(folder / "d"))
    return {**result, "left": seen(folder)}


def _used(folder: Path) -> int:
    found = os.statvfs(folder)
    return (found.f_blocks - found.f_bfree) * found.f_frsize


@in_namespace
def read_only(folder: Path) -> dict[str, Any]:
    """The cache, the home and the package cannot be written to."""
    mount(folder, "size=20m")
    os.environ["SWARMDATA_CACHE"] = str(folder / "cache")
    digest = read_manifest(make_tiny(folder / "cache" / "datasets" / TINY.id)).digest
    mount(folder, "remount,ro,size=20m")
    pytest.MonkeyPatch().setattr(
        request, "find_recipe", lambda name: TINY if "tiny" in name else find_recipe(name)
    )
    dataset = load("coop_nav-tiny", verify="full")
    return {
        "digests": [digest, dataset.digest],
        "source": dataset.source,
        "damage": [str(each) for each in examine(dataset.path)],
        "uncached": error_of(lambda: load("coop_nav-random-mini", offline=True)),
        "without a place for kernels": _without_kernels(folder),
    }


def _without_kernels(folder: Path) -> str:
    """What a fresh process says whose home, cache and package are read-only."""
    subprocess.run(["mount", "--bind", str(ROOT), str(ROOT)], check=True)
    subprocess.run(["mount", "-o", "remount,ro,bind", str(ROOT)], check=True)
    names = ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME", "SWARMDATA_CACHE")
    variables = {name: value for name, value in os.environ.items() if name not in names}
    uses = "import swarmdata.envs.world.world; print(swarmdata.make_env)"
    code = f"import sys; sys.path[:] = {sys.path!r}; {uses}"
    found = python("-c", code, cwd=ROOT, env={**variables, "HOME": str(folder)}, check=False)
    return f"{found.returncode} {found.stdout}{found.stderr}"
