"""Calls of Ray as futures: outcomes arrive, unless the future was cancelled."""

from concurrent.futures import Future

import pytest

from swarmdata.runtime.engines.cluster_executors import _hand_over


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
