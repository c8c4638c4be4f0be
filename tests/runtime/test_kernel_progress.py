"""What a command says while it compiles kernels: one line, with an estimate that was measured."""

import logging
import time
from types import SimpleNamespace

import pytest

from swarmdata.runtime import kernel_progress
from swarmdata.runtime.kernel_progress import KernelProgress


class Clock:
    now = 100.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr(time, "perf_counter", clock)
    return clock


def compile_one(progress: KernelProgress, clock: Clock, seconds: float) -> None:
    progress.begin()
    progress.begin()  # what it calls
    clock.now += seconds
    progress.end("numba.cpython.unicode")
    progress.end("swarmdata.numerics.geometry")


def test_it_says_one_line_when_the_pace_is_known(
    clock: Clock, caplog: pytest.LogCaptureFixture
) -> None:
    progress = KernelProgress()
    waiting, ready = SimpleNamespace(overloads={}), SimpleNamespace(overloads={1: 1})
    progress.kernels += [waiting] * 10 + [ready]
    with caplog.at_level(logging.WARNING, "swarmdata"):
        compile_one(progress, clock, kernel_progress.QUIET_TIME * 2)
        for _ in range(4):
            progress.waited()
            compile_one(progress, clock, 1.0)
        assert not caplog.records, "nine give no pace yet"
        for _ in range(3):
            compile_one(progress, clock, 1.0)
    (line,) = [record.message for record in caplog.records]
    assert "10 in 11 s, at most 10 are left, which take 11 s at this pace" in line
    assert progress.n_compiled == 12


def test_what_is_soon_done_is_not_told_however_long_the_pauses(
    clock: Clock, caplog: pytest.LogCaptureFixture
) -> None:
    progress = KernelProgress()
    with caplog.at_level(logging.WARNING, "swarmdata"):
        for _ in range(20):
            compile_one(progress, clock, 0.1)
            clock.now += 100
    assert not caplog.records


def test_it_can_be_silent(clock: Clock, caplog: pytest.LogCaptureFixture) -> None:
    progress = KernelProgress()
    with caplog.at_level(logging.WARNING, "swarmdata"):
        with progress.silent():
            for _ in range(10):
                compile_one(progress, clock, 100)
        assert not caplog.records
        compile_one(progress, clock, 100)
    assert len(caplog.records) == 1
