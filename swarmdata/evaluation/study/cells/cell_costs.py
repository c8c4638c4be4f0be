"""The cost of a cell in time and memory, recorded while it runs, so that a kill loses little."""

import json
import os
import platform
import re
import resource
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from swarmdata.specs.frozen import Frozen, NonNegative
from swarmdata.store import write_file

RECORD_INTERVAL = 10.0  # seconds between two records of an attempt


class Attempt(Frozen):
    """One process that worked on a cell, until its end or the last record before it was killed."""

    updates: Annotated[int, Field(ge=0)] = 0  # made by this process
    train_seconds: NonNegative = 0.0  # wall clock, without learning curves
    curve_seconds: NonNegative = 0.0
    evaluate_seconds: NonNegative = 0.0
    cpu_seconds: NonNegative = 0.0  # of all stages
    peak_mb: NonNegative = 0.0  # resident, including the memory-mapped dataset


class Cost(Frozen):
    """All attempts at a cell."""

    attempts: tuple[Attempt, ...] = ()
    machine: dict[str, Any] = Field(default_factory=dict)

    @property
    def updates_per_second(self) -> float | None:
        """Of training all seeds at once; None if nothing was trained."""
        seconds = sum(each.train_seconds for each in self.attempts)
        return sum(each.updates for each in self.attempts) / seconds if seconds else None

    @property
    def wall_seconds(self) -> float:
        """Wall-clock time of all stages and attempts."""
        return sum(
            each.train_seconds + each.curve_seconds + each.evaluate_seconds
            for each in self.attempts
        )

    @property
    def cpu_seconds(self) -> float:
        """Processor time of all stages and attempts."""
        return sum(each.cpu_seconds for each in self.attempts)

    @property
    def peak_mb(self) -> float:
        """Peak memory of the attempt that needed most."""
        return max((each.peak_mb for each in self.attempts), default=0.0)


def describe_machine() -> dict[str, Any]:
    """The properties of this machine that speed depends on, without its name."""
    file = Path("/proc/cpuinfo")  # of Linux
    text = file.read_text(encoding="utf-8") if file.exists() else ""
    model = re.search(r"^model name[^:\n]*:(.*)", text, re.MULTILINE)
    return {
        "cores": os.cpu_count(),
        "platform": f"{platform.system()}-{platform.machine()}",
        "processor": model[1].strip() if model else platform.processor() or "unknown",
        "python": platform.python_version(),
        "load": round(os.getloadavg()[0], 1),  # runnable processes at the start
    }


class CostMeter:
    """Measures one cell in this process; its peak memory may be that of cells before it."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.earlier = Cost.from_file(path).attempts if path.exists() else ()
        self.machine = describe_machine()
        self.seconds = {"train_seconds": 0.0, "curve_seconds": 0.0, "evaluate_seconds": 0.0}
        self.updates, self.written = 0, time.perf_counter()
        self.cpu_before = time.process_time()
        self.stages: list[str] = []
        self.since = time.perf_counter()

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Counts the time of a block as `<name>_seconds`; a nested block counts only as its own."""
        self._count()
        self.stages.append(f"{name}_seconds")
        try:
            yield
        finally:
            self._count()
            self.stages.pop()

    def add_updates(self, updates: int) -> None:
        """Adds updates, and writes the cost if the last record is old."""
        self.updates += updates
        if time.perf_counter() - self.written > RECORD_INTERVAL:
            self.write()

    def write(self) -> None:
        """Writes this attempt after the earlier ones."""
        self._count()
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss  # kilobytes on Linux
        now = Attempt(
            updates=self.updates,
            cpu_seconds=round(time.process_time() - self.cpu_before, 2),
            peak_mb=round(peak / 1024, 1),
            **{name: round(value, 2) for name, value in self.seconds.items()},
        )
        cost = Cost(attempts=(*self.earlier, now), machine=self.machine)
        write_file(self.path, json.dumps(cost.model_dump(mode="json"), indent=1).encode())
        self.written = time.perf_counter()

    def _count(self) -> None:
        now = time.perf_counter()
        if self.stages:
            self.seconds[self.stages[-1]] += now - self.since
        self.since = now
