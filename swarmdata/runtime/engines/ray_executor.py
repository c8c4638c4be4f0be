"""The executor of a Ray cluster: `ray://HOST:PORT`, or `ray` for processes of this machine."""

import os
from collections.abc import Callable
from concurrent.futures import Executor, Future
from functools import partial
from typing import Any

from swarmdata.errors import EngineError
from swarmdata.runtime.extras import require_extra


class RayExecutor(Executor):
    """Submits to a Ray that has been initialized; one core for each call."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> "Future[Any]":
        """Calls a function in a process of the cluster, once; cancelling ends the call there."""
        import ray  # noqa: PLC0415  (an extra)

        call = ray.remote(num_cpus=1, max_retries=0)(fn).remote(*args, **kwargs)
        future: Future[Any] = Future()
        future.add_done_callback(lambda ended: ray.cancel(call) if ended.cancelled() else None)
        call.future().add_done_callback(partial(_hand_over, future))
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Disconnects; processes that were started for this executor end."""
        import ray  # noqa: PLC0415  (an extra)

        ray.shutdown()


def _hand_over(future: "Future[Any]", call: "Future[Any]") -> None:
    """Gives a future the outcome of a call, unless it was cancelled meanwhile."""
    if not future.set_running_or_notify_cancel():
        return
    error = call.exception()
    if error is None:
        future.set_result(call.result())
    else:
        future.set_exception(error)


def open_ray(address: str | None) -> Executor:
    """Connects to a cluster, or starts processes on this machine.

    Args:
        address: such as `ray://HOST:PORT`; None: that of `RAY_ADDRESS`, as in jobs that Ray runs,
            or else processes of this machine, started for this.

    Raises:
        MissingExtraError: Ray is not installed.
        EngineError: no cluster answers.
    """
    require_extra("ray", "ray", "the engine ray")
    import ray  # noqa: PLC0415  (an extra)

    # without an address, Ray would look for the last cluster of this machine, which may be dead
    found = address or os.environ.get("RAY_ADDRESS", "local")
    try:
        ray.init(found, ignore_reinit_error=True, log_to_driver=False, include_dashboard=False)
    except Exception as error:  # ray.init raises plain ones, too, such as for a slow start
        raise EngineError(
            f"no Ray cluster answers at {found} ({error}). Start one with "
            "`ray start --head`, or use the engine ray without an address. What is finished "
            "is kept: run the same command again to continue."
        ) from error
    return RayExecutor()
