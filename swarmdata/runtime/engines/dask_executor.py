"""The executor of a Dask cluster: `dask://HOST:PORT` is the address of its scheduler."""

from concurrent.futures import Executor

from swarmdata.errors import EngineError
from swarmdata.runtime.extras import require_extra

CONNECT_SECONDS = 60
"""How long to wait for the scheduler, also for one that is started again."""


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
    except (OSError, ValueError) as error:
        raise EngineError(
            f"no Dask scheduler answers at {address} ({error}). Start one with `dask scheduler`, "
            "and workers with `dask worker HOST:PORT --nthreads 1`. What is finished is kept: "
            "run the same command again to continue."
        ) from error
    # jobs leave files, so that two equal ones are two; retries are the engine's
    executor: Executor = client.get_executor(pure=False, retries=0)
    return executor
