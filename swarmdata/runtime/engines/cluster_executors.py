"""The executor of a Dask cluster: `dask://HOST:PORT` is the address of its scheduler."""

import os
from collections.abc import Callable
from concurrent.futures import Executor, Future
from functools import partial
from typing import Any

from swarmdata.errors import EngineError
from swarmdata.runtime.extras import require_extra

CONNECT_SECONDS = 60  # how long to wait for the scheduler, also for one that is started again


class DaskExecutor(Executor):
    """Submits to a scheduler while its client is connected; later, its futures may never settle."""

    def __init__(self, client: Any) -> None:
        # jobs leave files, so that two equal ones are two; retries are the engine's
        self._client, self._inner = client, client.get_executor(pure=False, retries=0)

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> "Future[Any]":
        """Calls a function on a worker.

        Raises:
            ConnectionError: the client is not connected.
        """
        if self._client.status != "running":
            raise ConnectionError(f"the client of Dask is {self._client.status}")
        future: Future[Any] = self._inner.submit(fn, *args, **kwargs)
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Cancels what is not finished, where there is still a scheduler, and disconnects."""
        if self._client.status == "running":
            self._inner.shutdown(wait=wait)
        self._client.close()


def open_dask(address: str) -> Executor:
    """Connects to the scheduler at HOST:PORT.

    Raises:
        MissingExtraError: Dask is not installed.
        EngineError: no scheduler answers.
    """
    require_extra("distributed", "dask", "the engine dask")
    from distributed import Client  # noqa: PLC0415  (an extra)

    try:
        client = Client(f"tcp://{address}", timeout=CONNECT_SECONDS, set_as_default=False)
    except Exception as error:  # of the network, of the address, or Dask's own
        raise EngineError(
            f"no Dask scheduler answers at {address} ({error}). Start one with `dask scheduler`, "
            "and workers with `dask worker HOST:PORT --nthreads 1`. What is finished is kept: "
            "run the same command again to continue."
        ) from error
    return DaskExecutor(client)


class RayExecutor(Executor):
    """Submits to a Ray that has been initialized, for this if it `is_owned`; a core for a call."""

    def __init__(self, is_owned: bool) -> None:
        self._is_owned = is_owned

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> "Future[Any]":
        """Calls a function in a process of the cluster, once; cancelling ends the call there."""
        import ray  # noqa: PLC0415  (an extra)

        call = ray.remote(num_cpus=1, max_retries=0)(fn).remote(*args, **kwargs)
        future: Future[Any] = Future()
        future.add_done_callback(lambda ended: ray.cancel(call) if ended.cancelled() else None)
        call.future().add_done_callback(partial(_hand_over, future))
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Disconnects; processes that were started for this executor end, and no others."""
        import ray  # noqa: PLC0415  (an extra)

        if self._is_owned:
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
    """Connects to the cluster at `ray://HOST:PORT`.

    Without an address it is that of `RAY_ADDRESS`, as in jobs that Ray runs, or else processes of
    this machine, started for this. Where the process has initialized Ray itself, that is used.

    Raises:
        MissingExtraError: Ray is not installed.
        EngineError: no cluster answers.
    """
    require_extra("ray", "ray", "the engine ray")
    import ray  # noqa: PLC0415  (an extra)

    # without an address, Ray would look for the last cluster of this machine, which may be dead
    found = address or os.environ.get("RAY_ADDRESS", "local")
    is_owned = not ray.is_initialized()
    try:
        ray.init(found, ignore_reinit_error=True, log_to_driver=False, include_dashboard=False)
    except Exception as error:  # ray.init raises plain ones, too, such as for a slow start
        raise EngineError(
            f"no Ray cluster answers at {found} ({error}). Start one with "
            "`ray start --head`, or use the engine ray without an address. What is finished "
            "is kept: run the same command again to continue."
        ) from error
    return RayExecutor(is_owned)
