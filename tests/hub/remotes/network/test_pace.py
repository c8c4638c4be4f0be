"""The pace: deadlines and rates, from the environment or as they are."""

import pytest

from swarmdata.errors import HubError
from swarmdata.hub.remotes.hosts.web import WebRemote
from swarmdata.hub.remotes.network.backoff import Backoff, TooSlowError
from swarmdata.hub.remotes.network.pace import Meter, Pace
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
