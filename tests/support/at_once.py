"""Commands in processes of their own: forked from one that has imported them, not started anew."""

import multiprocessing
import os
import signal
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

SECONDS = 3000
"""For one command on a busy machine."""

FORKS = multiprocessing.get_context("forkserver")
FORKS.set_forkserver_preload(
    [
        "pytest",
        "swarmdata.cli.main",
        "swarmdata.hub.catalog.catalog",
        "swarmdata.building.part_maker",
        "swarmdata.cards.publish",
        "swarmdata.interop.export",
        "swarmdata.record",
    ]
)


def run_command(*words: str) -> None:
    from swarmdata.cli.main import main

    sys.argv = ["swarmdata", *words]
    main()


def _begin(
    work: Callable[..., None], words: tuple[str, ...], environment: dict[str, str], folder: str
) -> None:
    """In the child, whose forerunner knows no environment of a test."""
    os.environ.clear()
    os.environ.update(environment)
    for number, name in ((1, "out"), (2, "err")):
        os.dup2(os.open(Path(folder, name), os.O_WRONLY | os.O_CREAT), number)
    work(*words)


class Forked:
    """A function in a process of its own, with the environment of the caller.

    Args:
        words: its arguments.
        work: of a module that can be imported; the command line by default.
        variables: beside those of the environment.
    """

    def __init__(
        self,
        *words: str | Path,
        work: Callable[..., None] = run_command,
        variables: dict[str, str] | None = None,
    ) -> None:
        self._folder = tempfile.TemporaryDirectory()
        environment = {**os.environ, **(variables or {})}
        arguments = work, tuple(map(str, words)), environment, self._folder.name
        self._process = FORKS.Process(target=_begin, args=arguments, daemon=True)
        self._process.start()

    @property
    def pid(self) -> int:
        assert self._process.pid is not None
        return self._process.pid

    def send(self, number: signal.Signals) -> None:
        """Sends a signal; it must still be running."""
        assert self._process.is_alive(), self.end()
        os.kill(self.pid, number)

    def wait_for(self, condition: Callable[[str, str], bool]) -> None:
        end = time.monotonic() + SECONDS
        while not condition(*self._texts()):
            assert self._process.is_alive(), self.end()
            assert time.monotonic() < end, self._texts()
            time.sleep(0.005)

    def _texts(self) -> tuple[str, str]:
        files = [Path(self._folder.name, name) for name in ("out", "err")]
        out, err = (file.read_text("utf-8", "replace") if file.exists() else "" for file in files)
        return out, err

    def end(self) -> tuple[int | None, str, str]:
        """Waits for its end; the exit code, what it printed, and what it said on standard error."""
        self._process.join(SECONDS)
        out, err = self._texts()
        self._folder.cleanup()
        return self._process.exitcode, out, err


def run_at_once(*commands: tuple[str | Path, ...]) -> list[str]:
    """Runs commands at the same time; returns what each one printed."""
    outputs = []
    for running in [Forked(*command) for command in commands]:
        code, output, errors = running.end()
        assert code == 0, errors
        outputs.append(output)
    return outputs
