"""Workers that die, fail, print and outlive their supervisor."""

import signal
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

from swarmdata.errors import BuildError
from swarmdata.runtime import kernel_progress
from swarmdata.runtime.engines import crew as crew_module
from swarmdata.runtime.engines.crew import Crew
from swarmdata.runtime.engines.jobs import Job
from tests.runtime.engines.conftest import ENTRY, job, starts, wait_for


def test_workers_leave_it_to_the_supervisor_to_say_once_that_kernels_are_compiled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    said: list[str] = []
    monkeypatch.setattr(kernel_progress, "PROGRESS", kernel_progress.KernelProgress())
    monkeypatch.setattr(crew_module, "PROGRESS", kernel_progress.PROGRESS)
    kernel_progress.PROGRESS.tell = said.append
    with Crew(ENTRY, 2) as crew:
        crew.run([job(tmp_path, name, "say") for name in ("a", "b", "c")])
    assert said == ["compiling kernels"]


def test_bug_in_a_worker_is_an_error(tmp_path: Path) -> None:
    with Crew(ENTRY, 1) as crew, pytest.raises(BuildError, match="exit code 1 while doing buggy"):
        crew.run([job(tmp_path, "buggy", "crash")])


def test_worker_that_cannot_start_is_an_error() -> None:
    with Crew("no_such_module:work", 1) as crew, pytest.raises(BuildError, match="exit code 1"):
        crew.run([Job("anything", {})])


def test_crew_needs_a_worker() -> None:
    with pytest.raises(ValueError, match="n_workers is 0"), Crew("a:b", 0):
        pass


@pytest.mark.parametrize(
    ("action", "number"), [("forever", signal.SIGTERM), ("silently forever", signal.SIGKILL)]
)
def test_workers_end_when_the_supervisor_is_killed(
    tmp_path: Path, action: str, number: signal.Signals
) -> None:
    script = textwrap.dedent(f"""
        import sys; sys.path[:] = {sys.path!r}
        from swarmdata.runtime.engines.crew import Crew
        from swarmdata.runtime.engines.jobs import Job
        with Crew({ENTRY!r}, 1) as crew:
            crew.run([Job("long", {{"action": {action!r}, "note": {str(tmp_path / "long")!r}}})])
    """)
    supervisor = subprocess.Popen([sys.executable, "-c", script], stderr=subprocess.DEVNULL)
    wait_for(lambda: (tmp_path / "long").exists() and starts(tmp_path, "long") > 0)
    worker = int((tmp_path / "long").read_text().split()[0])
    supervisor.send_signal(number)
    supervisor.wait()

    wait_for(lambda: not is_running(worker))


def is_running(pid: int) -> bool:
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except (FileNotFoundError, ProcessLookupError):
        return False
    return state != "Z"
