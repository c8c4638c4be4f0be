"""Attempts are bounded and wait longer and longer."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmdata.errors import HubError
from swarmdata.hub.remotes.network.backoff import Backoff, TransientError, refuse_offline


@given(failures=st.integers(0, 6), attempts=st.integers(1, 6), after=st.none() | st.floats(0, 1e6))
def test_attempts_and_waits(failures: int, attempts: int, after: float | None) -> None:
    waits: list[float] = []
    tries: list[int] = []

    def action() -> str:
        tries.append(1)
        if len(tries) <= failures:
            raise TransientError("down", after)
        return "up"

    backoff = Backoff(attempts=attempts, wait=1.0, longest=5.0, sleep=waits.append)
    if failures < attempts:
        assert backoff.run("asking", action) == "up"
    else:
        with pytest.raises(HubError, match=r"asking failed .*: down\. Datasets in the cache"):
            backoff.run("asking", action)
    assert len(tries) == min(attempts, failures + 1)
    expected = [1.0, 2.0, 4.0, 5.0, 5.0] if after is None else [min(after, 5.0)] * 5
    assert waits == expected[: len(tries) - 1]


def test_other_errors_are_not_tried_again() -> None:
    def action() -> None:
        raise KeyError("a mistake")

    with pytest.raises(KeyError):
        Backoff(sleep=lambda wait: pytest.fail("waited")).run("asking", action)
    with pytest.raises(ValueError, match="attempts is 0"):
        Backoff(attempts=0).run("asking", action)


@pytest.mark.parametrize("value", ["0", "", "no"])
def test_not_offline(monkeypatch: pytest.MonkeyPatch, value: str) -> None:
    monkeypatch.setenv("HF_HUB_OFFLINE", value)
    refuse_offline("hf://org")
