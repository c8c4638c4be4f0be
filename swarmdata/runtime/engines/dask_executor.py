"""The executor of a Dask cluster: `dask://HOST:PORT` is the address of its scheduler."""

from collections.abc import Callable
from concurrent.futures import Executor, Future
from typing import Any

from swarmdata.errors import EngineError
from swarmdata.runtime.extras import require_extra

CONNECT_SECONDS = 60
"""How long to wait for the scheduler, also for one that is started again."""


class DaskExecutor(Executor):
    """Submits to a scheduler while its client is connected.

    A client that has lost its scheduler still takes calls, in the hope of finding it again; if it
    does not, it never settles their futures.

    Args:
        client: of Dask.
    """

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
    """Connects to a scheduler.

    Args:
        address: HOST:PORT.

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
