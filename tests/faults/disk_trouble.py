"""Full and read-only disks, for real: run inside a mount namespace of its own.

    unshare --user --map-root-user --mount python -m tests.faults.disk_trouble full|read_only FOLDER

Mounts a small disk at FOLDER, makes and loads datasets there, and prints one JSON object of what
was seen.
"""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from swarmdata import catalog, recipes
from swarmdata.behavior_policies.tiers import find_recipe
from swarmdata.catalog import load
from swarmdata.errors import SwarmdataError
from swarmdata.recipes import build_folder
from swarmdata.repairing import examine
from swarmdata.store import assemble, read_manifest
from tests.one_process import OneProcessCrew, use_one_process
from tests.tiny import TINY, make_tiny

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
        patch.setattr(recipes, "assemble", fill_then_assemble)
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


def _used(folder: Path) -> int:
    found = os.statvfs(folder)
    return (found.f_blocks - found.f_bfree) * found.f_frsize


def read_only(folder: Path) -> dict[str, Any]:
    """The cache, the home and the package cannot be written to."""
    mount(folder, "size=20m")
    os.environ["SWARMDATA_CACHE"] = str(folder / "cache")
    digest = read_manifest(make_tiny(folder / "cache" / "datasets" / TINY.id)).digest
    mount(folder, "remount,ro,size=20m")
    pytest.MonkeyPatch().setattr(
        catalog, "find_recipe", lambda name: TINY if "tiny" in name else find_recipe(name)
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
    code = f"import sys; sys.path[:] = {sys.path!r}; import swarmdata; print(swarmdata.load)"
    found = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, env={**variables, "HOME": str(folder)},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    return f"{found.returncode} {found.stdout}{found.stderr}"


def main() -> None:
    use_one_process(pytest.MonkeyPatch())
    work = {"full": full, "read_only": read_only}[sys.argv[1]]
    print(json.dumps(work(Path(sys.argv[2]))))


if __name__ == "__main__":
    main()
