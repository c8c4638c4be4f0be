"""The pace: deadlines and rates, from the environment or as they are."""

import threading
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import pytest

from swarmdata.errors import HubError
from swarmdata.hub.remotes.hosts.web import WebRemote
from swarmdata.hub.remotes.network import pace
from swarmdata.hub.remotes.network.backoff import (
    SLICE_SECONDS,
    Backoff,
    StoppedError,
    TooSlowError,
    check_stop,
    pause,
)
from swarmdata.hub.remotes.network.pace import Meter, Pace, bytes_in, run_all, watched
from tests.hub.remotes.faults import Clock


@pytest.fixture
def clock() -> Clock:
    return Clock()


def test_an_answer_has_a_deadline(clock: Clock) -> None:
    meter = Meter(Pace(answer_seconds=5.0), "a host", clock)
    meter.count(10**9)
    clock.now += 4.9
    assert meter.seconds_left() == pytest.approx(0.1)
    clock.now += 0.1
    with pytest.raises(TooSlowError, match="a host did not answer within 5 s"):
        meter.seconds_left()


def test_a_body_has_a_least_rate_in_every_window(clock: Clock) -> None:
    meter = Meter(Pace(least_rate=100.0, window_seconds=10.0), "a host", clock)
    meter.begin_body()
    for _ in range(3):
        meter.count(1000)
        clock.now += 10.0
        assert meter.seconds_left() == 10.0
    meter.count(999)
    clock.now += 9.0
    assert meter.seconds_left() == pytest.approx(1.0)
    clock.now += 1.0
    with pytest.raises(TooSlowError, match="gave 999 bytes in 10 s, fewer than the least rate"):
        meter.seconds_left()


def test_settings_of_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    assert Pace.from_environment() == Pace()
    monkeypatch.setenv("SWARMDATA_ANSWER_SECONDS", "7")
    monkeypatch.setenv("SWARMDATA_LEAST_RATE", "2e5")
    monkeypatch.setenv("SWARMDATA_RATE_SECONDS", "9.5")
    assert Pace.from_environment() == Pace(7.0, 2e5, 9.5)


@pytest.mark.parametrize("text", ["0", "-1", "nan", "inf", "fast"])
@pytest.mark.parametrize("name", ["ANSWER_SECONDS", "LEAST_RATE", "RATE_SECONDS"])
def test_settings_that_are_none(monkeypatch: pytest.MonkeyPatch, name: str, text: str) -> None:
    monkeypatch.setenv(f"SWARMDATA_{name}", text)
    with pytest.raises(HubError, match=f"SWARMDATA_{name} is '{text}', expected a positive number"):
        WebRemote("https://host")


def test_a_slow_server_is_asked_twice_and_no_more() -> None:
    calls = []

    def ask() -> None:
        calls.append(0)
        raise TooSlowError("it did not answer within 30 s")

    with pytest.raises(HubError, match="failed 2 times: it did not answer"):
        Backoff(attempts=5, sleep=lambda seconds: None).run("asking", ask)
    assert len(calls) == 2


def nothing() -> None:
    """A tick that is not looked at."""


@pytest.fixture
def hanging(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[], object]]:
    """Waits as a client library does, whatever happens meanwhile; it returns after the test.

    So whoever waited for it would do so for ever.
    """
    monkeypatch.setattr(pace, "GRACE_SECONDS", 0.05)
    over = threading.Event()
    yield over.wait
    over.set()


@pytest.fixture
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """What may end by itself has the time for it, on a busy machine."""
    monkeypatch.setattr(pace, "GRACE_SECONDS", 300.0)


def test_ctrl_c_takes_two_seconds_at_most() -> None:
    """Row 60: what jobs wait for they wait for in slices, and hanging ones are left."""
    assert SLICE_SECONDS + pace.GRACE_SECONDS < 2.0


def fail() -> None:
    raise ZeroDivisionError


def test_all_jobs_are_done_a_few_at_a_time() -> None:
    done: list[int] = []
    running, most = [0], [0]
    lock = threading.Lock()

    def job(number: int) -> None:
        with lock:
            running[0] += 1
            most[0] = max(most[0], running[0])
        time.sleep(0.01)
        with lock:
            running[0] -= 1
            done.append(number)

    ticks: list[int] = []
    run_all([partial(job, k) for k in range(20)], 3, lambda: ticks.append(0), 0.005)
    assert sorted(done) == list(range(20))
    assert most[0] == 3
    assert ticks
    run_all([], 3, nothing, 0.1)


@pytest.mark.usefixtures("patient")
@pytest.mark.parametrize("wait", [partial(pause, 600.0), check_stop], ids=["waiting", "looking"])
def test_the_first_error_stops_the_rest(wait: Callable[[], None]) -> None:
    ended: list[type[BaseException]] = []
    began = threading.Event()

    def wait_long() -> None:
        began.set()
        try:
            while True:
                wait()
                time.sleep(0.001)
        except BaseException as error:
            ended.append(type(error))
            raise

    def fail_later() -> None:
        began.wait()
        fail()

    never: list[int] = []
    with pytest.raises(ZeroDivisionError):
        run_all([wait_long, fail_later, lambda: never.append(0)], 2, nothing, 0.1)
    assert ended == [StoppedError]
    assert never == []


def test_nothing_waits_long_for_a_job_that_hangs(hanging: Callable[[], None]) -> None:
    with pytest.raises(ZeroDivisionError):
        run_all([hanging, fail], 2, nothing, 0.1)


@pytest.mark.usefixtures("patient")
def test_ctrl_c_stops_all_jobs() -> None:
    def interrupt() -> None:
        raise KeyboardInterrupt

    before = threading.active_count()
    with pytest.raises(KeyboardInterrupt):
        run_all([partial(pause, 600.0)] * 3, 2, interrupt, 0.05)
    assert threading.active_count() <= before  # those of earlier tests may end meanwhile


def test_a_watched_call_returns_or_raises() -> None:
    assert watched(lambda: 3, Meter(Pace(), "x")) == 3
    with pytest.raises(ZeroDivisionError):
        watched(fail, Meter(Pace(), "x"))


@pytest.mark.usefixtures("patient")
def test_a_watched_call_ends_with_the_jobs() -> None:
    over = threading.Event()

    def watch() -> None:
        watched(over.wait, Meter(Pace(), "x"))

    with pytest.raises(ZeroDivisionError):
        run_all([watch, fail], 2, nothing, 0.1)
    over.set()


def test_bytes_in_a_folder_that_changes(tmp_path: Path) -> None:
    (tmp_path / "deep").mkdir()
    (tmp_path / "deep" / "x").write_bytes(b"123")
    (tmp_path / "dangling").symlink_to("nowhere")
    assert bytes_in(tmp_path) == 3
    assert bytes_in(tmp_path / "nowhere") == 0
