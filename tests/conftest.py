"""Settings that every test shares."""

import gc
import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Generator, Iterator
from functools import cache
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from hypothesis import settings
from platformdirs import user_cache_path

if TYPE_CHECKING:
    from swarmdata.specs.task_spec import TaskSpec

# Before NumPy or torch start their thread pools: tests run small arrays, often several at once.
os.environ.setdefault("OMP_NUM_THREADS", "1")
# Containers often forbid byte code: every run would rewrite all assertions, and every interpreter
# that a test starts would compile all modules
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False
# `cache_folder` below moves the cache for every test, and compiling takes a minute
os.environ.setdefault("NUMBA_CACHE_DIR", str(user_cache_path("swarmdata") / "kernels"))
# tests make and remove 80,000 files and folders, ten times as fast in memory
MEMORY = Path("/dev/shm")
if os.access(MEMORY, os.W_OK) and shutil.disk_usage(MEMORY).free > 4 << 30:
    os.environ.setdefault("PYTEST_DEBUG_TEMPROOT", str(MEMORY))

# a shell starts background jobs with the interrupt ignored, and the processes of tests inherit that
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# the default run is the same every time; the nightly profile explores
settings.register_profile("quick", deadline=None, max_examples=15, derandomize=True)
settings.register_profile("nightly", deadline=None, max_examples=500)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "quick"))


WHOLE_FILE = re.compile(r"^pytestmark = \[?\s*pytest\.mark\.(slow|learns)\b", re.MULTILINE)
"""The mark that all tests of a file have; of several, it is the first."""


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--update-golden", action="store_true", help="rewrite golden files from what the code gives"
    )


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Files of slow tests only are not even imported where these do not run: JAX takes seconds."""
    if collection_path.is_dir() or not collection_path.match("test_*.py"):
        return None
    mark = WHOLE_FILE.search(collection_path.read_text("utf-8"))
    return (mark is not None and f"not {mark[1]}" in config.option.markexpr) or None


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """What collecting makes stays to the end: the garbage collector need not look at it again.

    What tests make goes with its last reference; with the usual thresholds, looking for the little
    that does not takes a tenth of the run.
    """
    gc.disable()
    found = yield
    gc.freeze()
    gc.set_threshold(50_000, 50, 100)
    gc.enable()
    return found


@pytest.fixture
def update_golden(request: pytest.FixtureRequest) -> bool:
    """Whether golden files are to be rewritten instead of compared."""
    return bool(request.config.getoption("--update-golden"))


@pytest.fixture(scope="session")
def caches(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Folders that do not exist yet; `mktemp` lists all folders of the session each time."""
    root = tmp_path_factory.mktemp("caches")
    return (root / str(number) for number in count())


@pytest.fixture(autouse=True)
def cache_folder(caches: Iterator[Path], monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty dataset cache and no remotes, so that no test reads or fills the user's."""
    folder = next(caches)
    folder.mkdir()
    monkeypatch.setenv("SWARMDATA_CACHE", str(folder))
    monkeypatch.setenv("SWARMDATA_REMOTES", "")
    return folder


@pytest.fixture(scope="session", autouse=True)
def nothing_waits_for_the_disk() -> Iterator[None]:
    """A dataset of seconds flushes 130 files, which takes longer than making it.

    No machine stops in the middle of a test; `tests/runtime/test_atomic.py` says what is flushed.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "fsync", lambda descriptor: None)
        yield


@pytest.fixture(scope="session", autouse=True)
def one_command_line() -> Iterator[None]:
    """Typer makes its command anew in every call of its runner, longer than most commands take."""
    import typer.main
    import typer.testing

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(typer.testing, "_get_command", cache(typer.main.get_command))
        yield


@pytest.fixture(scope="module")
def one_process() -> Iterator[None]:
    from tests.support.one_process import use_one_process

    with pytest.MonkeyPatch.context() as patch:
        use_one_process(patch)
        yield


@pytest.fixture(scope="session")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The dataset of `tests.support.tiny.TINY`; to be copied by who changes it."""
    from tests.support.tiny import TINY, make_tiny

    return make_tiny(tmp_path_factory.mktemp("tiny") / TINY.id)


@pytest.fixture(scope="session")
def record() -> Callable[..., Path]:
    """Writes a small dataset of policies without checkpoints, in this process."""
    from swarmdata.building.part_maker import make_part
    from swarmdata.registry.components import make_env
    from swarmdata.specs.recipe import PolicySource, Recipe
    from tests.support.made_episodes import stored

    def write(out: Path, spec: "TaskSpec", policies: tuple[str, ...], tier: str = "small") -> Path:
        recipe = Recipe(
            id=f"{spec.task}-small-v0",
            tier=tier,
            spec=spec,
            policies=tuple(PolicySource(label=name, name=name) for name in policies),
            n_steps=8 * spec.horizon,
            part_episodes=8,
        )
        env = make_env(spec, 8)
        stored(out, recipe, [make_part(recipe, k, 0, env) for k in range(len(policies))])
        return out

    return write


@pytest.fixture(params=["tmpfs", "bind"])
def mounted(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Path]:
    """An empty folder at which a file system is mounted, or another folder, as by `docker -v`."""
    folder, elsewhere = tmp_path / "outer" / "mounted", tmp_path / "elsewhere"
    folder.mkdir(parents=True)
    elsewhere.mkdir()
    kinds = {"tmpfs": ["-t", "tmpfs", "none"], "bind": ["--bind", str(elsewhere)]}
    if subprocess.run(["mount", *kinds[request.param], str(folder)], check=False).returncode:
        pytest.skip("mounting needs the rights of root")
    try:
        yield folder
    finally:
        subprocess.run(["umount", str(folder)], check=True)
