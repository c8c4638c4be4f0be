"""Calls of Ray as futures: outcomes arrive, unless the future was cancelled."""

import sys
from concurrent.futures import Future
from unittest.mock import MagicMock

import pytest

from swarmdata.runtime.engines.cluster_executors import _hand_over, open_ray


def test_outcomes_are_handed_over() -> None:
    future, call, failed, failing = Future[int](), Future[int](), Future[int](), Future[int]()
    call.add_done_callback(lambda done: _hand_over(future, done))
    failing.add_done_callback(lambda done: _hand_over(failed, done))
    call.set_result(3)
    failing.set_exception(OSError("the worker was lost"))
    assert future.result(0) == 3
    with pytest.raises(OSError, match="the worker was lost"):
        failed.result(0)


def test_a_call_that_ends_after_it_was_cancelled_is_ignored() -> None:
    future, call = Future[int](), Future[int]()
    assert future.cancel()
    call.set_result(3)
    _hand_over(future, call)
    assert future.cancelled()


@pytest.mark.parametrize("is_users", [False, True])
def test_a_ray_that_the_user_has_initialized_is_not_shut_down(
    monkeypatch: pytest.MonkeyPatch, is_users: bool
) -> None:
    ray = MagicMock(__spec__="found")
    ray.is_initialized.return_value = is_users
    monkeypatch.setitem(sys.modules, "ray", ray)
    open_ray(None).shutdown()
    assert ray.shutdown.called is not is_users
