"""Workers that die, fail, print and outlive their supervisor."""

import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import pytest

from swarmdata.errors import BuildError
from swarmdata.runtime import kernel_progress
from swarmdata.runtime.engines import crew as crew_module
from swarmdata.runtime.engines.crew import Crew
from swarmdata.runtime.engines.jobs import Job

HANDLER = """
import os, signal, sys, time
from pathlib import Path
from swarmdata.errors import SpecError

def handle(payload, report):
    action, note = payload["action"], Path(payload["note"])
    print("noise on standard output")
    report(3)
    with note.open("a") as file:
        file.write(f"{os.getpid()} {os.environ['OMP_NUM_THREADS']}\\n")
    starts = len(note.read_text().splitlines())
    if action == "die" or (action == "die once" and starts == 1):
        os.kill(os.getpid(), signal.SIGKILL)
    if action == "refuse":
        raise SpecError("this cannot be done")
    if action == "crash":
        raise ZeroDivisionError("a bug")
    if action == "compile":
        from swarmdata.runtime.kernel_progress import PROGRESS
        PROGRESS.say("compiling kernels")
    while action in ("forever", "silently forever"):
        if action == "forever":
            report(1)
        time.sleep(0.02)
    report(4)

def work():
    return handle
"""


@pytest.fixture
def entry(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    (tmp_path / "handler_for_test.py").write_text(HANDLER)
    monkeypatch.syspath_prepend(str(tmp_path))
    return "handler_for_test:work"


def make_job(folder: Path, name: str, action: str = "work") -> Job:
    return Job(name, {"action": action, "note": str(folder / name)})


def starts(folder: Path, name: str) -> list[str]:
    return (folder / name).read_text().splitlines()


def test_workers_leave_it_to_the_supervisor_to_say_once_that_kernels_are_compiled(
    tmp_path: Path, entry: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    said: list[str] = []
    monkeypatch.setattr(kernel_progress, "PROGRESS", kernel_progress.KernelProgress())
    monkeypatch.setattr(crew_module, "PROGRESS", kernel_progress.PROGRESS)
    kernel_progress.PROGRESS.tell = said.append
    with Crew(entry, 2) as crew:
        crew.run([make_job(tmp_path, name, "compile") for name in ("a", "b", "c")])
    assert said == ["compiling kernels"]


def test_all_jobs_are_done_once_and_progress_adds_up(tmp_path: Path, entry: str) -> None:
    reports: list[int] = []
    with Crew(entry, 2) as crew:
        crew.run([make_job(tmp_path, f"job-{k}") for k in range(5)], reports.append)
        crew.run([make_job(tmp_path, "later")], reports.append)

    assert sum(reports) == 6 * 7
    lines = [starts(tmp_path, f"job-{k}") for k in range(5)]
    assert all(len(line) == 1 for line in lines)
    assert len({line[0].split()[0] for line in lines}) <= 2
    assert all(line[0].split()[1] == "1" for line in lines), "BLAS must use one thread"


def test_bug_in_a_worker_is_an_error(tmp_path: Path, entry: str) -> None:
    with Crew(entry, 1) as crew, pytest.raises(BuildError, match="exit code 1 while doing buggy"):
        crew.run([make_job(tmp_path, "buggy", "crash")])


def test_worker_that_cannot_start_is_an_error() -> None:
    with Crew("no_such_module:work", 1) as crew, pytest.raises(BuildError, match="exit code 1"):
        crew.run([Job("anything", {})])


def test_crew_needs_a_worker() -> None:
    with pytest.raises(ValueError, match="n_workers is 0"), Crew("a:b", 0):
        pass


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
@pytest.mark.parametrize("action", ["forever", "silently forever"])
def test_workers_end_when_the_supervisor_is_killed(
    tmp_path: Path, entry: str, action: str, number: signal.Signals
) -> None:
    script = textwrap.dedent(f"""
        import sys; sys.path[:] = {sys.path!r}
        from swarmdata.runtime.engines.crew import Crew
        from swarmdata.runtime.engines.jobs import Job
        with Crew({entry!r}, 1) as crew:
            crew.run([Job("long", {{"action": {action!r}, "note": {str(tmp_path / "long")!r}}})])
    """)
    supervisor = subprocess.Popen([sys.executable, "-c", script], stderr=subprocess.DEVNULL)
    wait_for(lambda: (tmp_path / "long").exists() and bool(starts(tmp_path, "long")))
    worker = int(starts(tmp_path, "long")[0].split()[0])
    supervisor.send_signal(number)
    supervisor.wait()

    wait_for(lambda: not is_running(worker))


def wait_for(condition: object, seconds: float = 300.0) -> None:
    assert callable(condition)
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.02)


def is_running(pid: int) -> bool:
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except (FileNotFoundError, ProcessLookupError):
        return False
    return state != "Z"
