"""The engine `local`: worker processes of this machine; one that is killed costs its job a retry.

A worker is a new interpreter, which reads jobs from its standard input and reports on its standard
output, one JSON object per line. It ends with its standard input, and so with its supervisor.
"""

import json
import os
import selectors
import signal
import subprocess
import sys
from collections import Counter, deque
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, field
from queue import SimpleQueue
from threading import Thread
from typing import IO, Any, Self

from swarmdata.errors import BuildError, SwarmdataError
from swarmdata.runtime.engines.jobs import (
    MAX_ATTEMPTS,
    THREAD_VARIABLES,
    Job,
    OnFailure,
    Report,
    load_handler,
    stop_at_failure,
)
from swarmdata.runtime.kernel_progress import PROGRESS


@dataclass(eq=False)
class _Worker:
    """One process, what it is doing, and the part of its output that is not yet a whole line."""

    process: "subprocess.Popen[bytes]"
    stdin: IO[bytes]
    stdout: IO[bytes]
    job: Job | None = None
    reported: int = 0
    buffer: bytes = b""

    def assign(self, job: Job) -> None:
        self.job, self.reported = job, 0
        with suppress(BrokenPipeError):  # it was killed while idle: the end of its output says so
            self.stdin.write(json.dumps(job.payload).encode() + b"\n")
            self.stdin.flush()

    def messages(self) -> list[dict[str, Any]] | None:
        """The whole lines that are there to read, or None at the end of the output."""
        data = os.read(self.stdout.fileno(), 1 << 16)
        if not data:
            return None
        *lines, self.buffer = (self.buffer + data).split(b"\n")
        return [json.loads(line) for line in lines]

    def fail(self, problem: str, on_failure: OnFailure) -> None:
        """Hands over that its job failed, or raises it where it has none."""
        error = BuildError(problem)
        if self.job is None:
            raise error
        on_failure(self.job, error)

    def stop(self) -> None:
        self.process.kill()
        self.process.wait()
        self.stdout.close()
        with suppress(BrokenPipeError):  # a job that the dead worker never read
            self.stdin.close()


@dataclass
class Crew:
    """Processes that are kept from one `run` to the next, and killed when the context is left."""

    entry: str  # "module:function" that returns the handler of a worker
    n_workers: int  # how many processes at most, at least 1
    renews: bool = False  # whether each job gets a new process, which frees memory
    _workers: list[_Worker] = field(default_factory=list)
    _selector: selectors.BaseSelector = field(default_factory=selectors.DefaultSelector)

    def __enter__(self) -> Self:
        if self.n_workers < 1:
            raise ValueError(f"n_workers is {self.n_workers}, expected at least 1")
        return self

    def __exit__(self, *_: object) -> None:
        for worker in self._workers:
            worker.stop()
        self._workers.clear()
        self._selector.close()

    def run(
        self,
        jobs: Iterable[Job],
        progress: Report = lambda amount: None,
        on_failure: OnFailure = stop_at_failure,
    ) -> None:
        """Does all jobs, in any order; `progress` gets what handlers report.

        Raises:
            BuildError: a worker could not start; or a job failed, by default.
        """
        queue, attempts = deque(jobs), Counter[str]()
        while queue or any(worker.job for worker in self._workers):
            self._hire(len(queue))
            for worker in self._workers:
                if queue and worker.job is None:
                    worker.assign(queue.popleft())
            for key, _ in self._selector.select():
                lost = self._listen(key.data, progress, on_failure)
                if lost is None:
                    continue
                attempts[lost.name] += 1
                if attempts[lost.name] == MAX_ATTEMPTS:
                    on_failure(lost, _killed(lost, key.data.process.returncode))
                else:
                    queue.appendleft(lost)

    def _hire(self, n_waiting: int) -> None:
        """Starts workers until all waiting jobs have one, or there are `n_workers`."""
        n_busy = sum(worker.job is not None for worker in self._workers)
        while len(self._workers) < min(self.n_workers, n_busy + n_waiting):
            worker = _start(self.entry)
            self._workers.append(worker)
            self._selector.register(worker.stdout, selectors.EVENT_READ, worker)

    def _listen(self, worker: _Worker, progress: Report, on_failure: OnFailure) -> Job | None:
        """Takes a worker's messages; returns the job that was lost if the worker has ended."""
        messages = worker.messages()
        if messages is None:
            return self._dismiss(worker, progress, on_failure)
        for message in messages:
            if "kernels" in message:
                PROGRESS.say(message["kernels"])
                continue
            if "progress" in message:
                worker.reported += message["progress"]
                progress(message["progress"])
                continue
            if "error" in message:
                name = worker.job.name if worker.job else "starting a worker"
                worker.fail(f"{name} failed: {message['error']}", on_failure)
            worker.job = None
            if self.renews:
                self._remove(worker)
                break
        return None

    def _remove(self, worker: _Worker) -> None:
        self._selector.unregister(worker.stdout)
        self._workers.remove(worker)
        worker.stop()

    def _dismiss(self, worker: _Worker, progress: Report, on_failure: OnFailure) -> Job | None:
        """Removes a worker that has ended; an idle one is simply gone."""
        worker.process.wait()
        code, job = worker.process.returncode, worker.job
        self._remove(worker)
        if job is not None:
            progress(-worker.reported)
        if code <= 0:
            return job
        doing = job.name if job else "no job"
        problem = f"a worker process ended with exit code {code} while doing {doing}"
        worker.fail(f"{problem}; its error is printed above", on_failure)
        return None


def _start(entry: str) -> _Worker:
    code = f"import sys; sys.path[:] = {sys.path!r}; from {__name__} import serve; serve({entry!r})"
    process = subprocess.Popen(
        [sys.executable, "-c", code],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env={**os.environ, **dict.fromkeys(THREAD_VARIABLES, "1")},
    )
    assert process.stdin is not None
    assert process.stdout is not None
    return _Worker(process, process.stdin, process.stdout)


def _killed(job: Job, code: int) -> BuildError:
    name = signal.Signals(-code).name if code < 0 else f"exit code {code}"
    return BuildError(
        f"{job.name} failed: its worker process ended {MAX_ATTEMPTS} times, last by {name}. If "
        "memory ran out, use fewer workers. What is finished is kept: run the same command again "
        "to continue."
    )


def serve(entry: str) -> None:
    """Does jobs from standard input until it ends; the main loop of a worker.

    A `SwarmdataError` or `OSError` that the handler of `entry` raises is sent to the supervisor.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches everyone; the supervisor acts
    lines = os.fdopen(os.dup(1), "w", buffering=1, encoding="utf-8")
    os.dup2(2, 1)  # whatever else prints must not garble the messages

    def send(**message: Any) -> None:
        lines.write(json.dumps(message) + "\n")

    PROGRESS.tell = lambda text: send(kernels=text)
    handle, jobs = load_handler(entry), SimpleQueue[bytes]()
    Thread(target=_receive, args=(jobs,), daemon=True).start()
    while True:
        payload = json.loads(jobs.get())
        try:
            handle(payload, lambda amount: send(progress=amount))
        except (SwarmdataError, OSError) as error:
            if isinstance(error, BrokenPipeError):
                os._exit(0)  # the supervisor is gone
            send(error=f"{type(error).__name__}: {error}")
        else:
            send(done=True)


def _receive(jobs: SimpleQueue[bytes]) -> None:
    """Takes jobs from standard input; ends the process where it ends, since nobody waits then."""
    buffer = b""  # a thread in a buffered reader would keep the interpreter from shutting down
    while data := os.read(0, 1 << 16):
        *lines, buffer = (buffer + data).split(b"\n")
        for line in lines:
            jobs.put(line)
    os._exit(0)
