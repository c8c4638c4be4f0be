"""The engine over any `concurrent.futures.Executor`; lost jobs are submitted again."""

import threading
from collections import Counter, deque
from collections.abc import Callable, Iterable
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, wait
from dataclasses import dataclass, field
from typing import Any, Self

from swarmdata.errors import BuildError, EngineError
from swarmdata.runtime.engines.jobs import (
    MAX_ATTEMPTS,
    Job,
    OnFailure,
    Report,
    do_job,
    stop_at_failure,
)

MAX_SUBMITTED = 1_000  # jobs that an executor holds at once
SHUTDOWN_SECONDS = 10  # an executor that does not end in this time is left to itself


@dataclass
class ExecutorEngine:
    """Does jobs by an executor, kept from one `run` to the next.

    Leaving it cancels what has not begun; the executor is shut down if the engine has opened it.
    """

    entry: str  # "module:function" that returns the handler of a process
    open_executor: Callable[[], Executor]  # called again when the last one is broken
    is_owned: bool = True  # whether the engine shuts executors down
    _executor: Executor | None = None
    _running: dict["Future[dict[str, Any]]", Job] = field(default_factory=dict)

    def __enter__(self) -> Self:
        self._executor = self.open_executor()
        return self

    def __exit__(self, *_: object) -> None:
        for future in self._running:
            future.cancel()
        self._running.clear()
        self._close()

    def run(
        self,
        jobs: Iterable[Job],
        progress: Report = lambda amount: None,
        on_failure: OnFailure = stop_at_failure,
    ) -> None:
        """Does all jobs, as `Crew.run`, but progress is reported once a job is done.

        Raises:
            EngineError: there is no executor any more that takes jobs.
        """
        queue, attempts = deque(jobs), Counter[str]()

        def lose(job: Job, error: BaseException) -> None:
            attempts[job.name] += 1
            if attempts[job.name] == MAX_ATTEMPTS:
                on_failure(job, _lost(job, error))
            else:
                queue.append(job)

        while queue or self._running:
            while queue and len(self._running) < MAX_SUBMITTED:
                self._submit(queue.popleft(), lose)
            done, _ = wait(self._running, return_when=FIRST_COMPLETED)
            for future in done:
                job = self._running.pop(future)
                try:
                    outcome = future.result()
                except (Exception, CancelledError) as error:  # the engine's own: it lost the job
                    lose(job, error)
                    continue
                if "error" in outcome:
                    on_failure(job, BuildError(f"{job.name} failed: {outcome['error']}"))
                else:
                    progress(outcome["progress"])

    def _submit(self, job: Job, lose: Callable[[Job, BaseException], None]) -> None:
        """Hands a job to the executor; to a new one if it takes no more, and its jobs are lost."""
        assert self._executor is not None
        try:
            future = self._executor.submit(do_job, self.entry, job.payload)
        except Exception as error:  # each engine has its own ones for a lost connection
            if not self.is_owned:
                raise _refused(error, "call again with a new one") from error
            self._close()
            for open_future in [each for each in self._running if not each.done()]:
                lose(self._running.pop(open_future), error)
            self._executor = self.open_executor()
            try:
                future = self._executor.submit(do_job, self.entry, job.payload)
            except EngineError:
                raise
            except Exception as again:
                raise _refused(again, "run the same command again to continue") from again
        self._running[future] = job

    def _close(self) -> None:
        if self._executor is not None and self.is_owned:
            # a broken one may wait for ever
            ending = threading.Thread(target=self._executor.shutdown, kwargs={"wait": False})
            ending.daemon = True
            ending.start()
            ending.join(timeout=SHUTDOWN_SECONDS)
        self._executor = None


def _refused(error: Exception, what_to_do: str) -> EngineError:
    return EngineError(
        f"the executor takes no more jobs ({type(error).__name__}: {error}). What is finished is "
        f"kept: {what_to_do}."
    )


def _lost(job: Job, error: BaseException) -> BuildError:
    return BuildError(
        f"{job.name} failed: it was lost {MAX_ATTEMPTS} times, last by {type(error).__name__}: "
        f"{error}. If memory ran out, let fewer jobs run at once. What is finished is kept: run "
        "the same command again to continue."
    )
