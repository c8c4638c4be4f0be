"""Jobs whose handler does what their payload says, and notes each of its starts."""

import os
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from swarmdata.runtime.engines.jobs import Job

HANDLER = """
import os, signal, time  # each start of a job is a line: the process, and the threads of BLAS
from pathlib import Path
from swarmdata.errors import SpecError

def handle(payload, report):
    action, note = payload["action"], Path(payload["note"])
    print("noise on standard output")
    report(3)
    with note.open("a") as file:
        file.write(f"{os.getpid()} {os.environ.get('OMP_NUM_THREADS')}\\n")
    starts = len(note.read_text().splitlines())
    if action == "die" or (action == "die once" and starts == 1):
        os.kill(os.getpid(), signal.SIGKILL)
    if action == "refuse":
        raise SpecError("this cannot be done")
    if action == "crash":
        raise ZeroDivisionError("a bug")
    if action == "say":
        from swarmdata.runtime.kernel_progress import PROGRESS
        PROGRESS.say("compiling kernels")
    while action in ("forever", "silently forever"):
        if action == "forever":
            report(1)
        time.sleep(0.02)
    time.sleep({"wait": 2.0, "pause": 0.3}.get(action, 0.0))
    if action == "compile":
        from engine_kernel import double
        assert double(1.5) == 3.0
        note.write_text(str(sum(double.stats.cache_misses.values())))
    report(4)

def work():
    return handle
"""

ENTRY = "engine_handler:work"


@pytest.fixture(autouse=True)
def handler(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The processes of engines find the handler `ENTRY`."""
    (tmp_path / "engine_handler.py").write_text(HANDLER)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), str(Path.cwd())]))


def job(folder: Path, name: str, action: str = "work") -> Job:
    return Job(name, {"action": action, "note": str(folder / name)})


def starts(folder: Path, name: str) -> int:
    return len((folder / name).read_text().splitlines())


def wait_for(condition: Callable[[], object]) -> None:
    end = time.monotonic() + 300.0
    while not condition():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.02)


def once_there(folder: Path, pattern: str, action: Callable[[], object]) -> threading.Thread:
    """Does something in another thread as soon as a folder has a file of a name."""

    def watch() -> None:
        wait_for(lambda: list(folder.glob(pattern)))
        action()

    thread = threading.Thread(target=watch, daemon=True)
    thread.start()
    return thread
