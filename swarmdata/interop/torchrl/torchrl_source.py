"""Datasets by name in TorchRL: `load_dataset("swarmdata:coop_nav-medium")` gives a replay buffer.

swarmdata.register_torchrl()
buffer = torchrl.data.datasets.load_dataset("swarmdata:coop_nav-medium", batch_size=256)
"""

from typing import Any

from swarmdata.errors import MissingExtraError
from swarmdata.hub.catalog.catalog import load
from swarmdata.interop.torchrl.torchrl import replay_buffer

PREFIX = "swarmdata"
"""What names of this library's datasets begin with in TorchRL, before a colon."""


def register_torchrl() -> None:
    """Makes `load` a source of TorchRL's `load_dataset`, in this process.

    Raises:
        MissingExtraError: TorchRL is not installed, or is too old to have such a registry (before
            0.14).
    """
    try:
        from torchrl.data.datasets import register_dataset  # noqa: PLC0415  (an extra)
    except ImportError as error:
        raise MissingExtraError("torchrl>=0.14", "torchrl", "register_torchrl") from error
    register_dataset(PREFIX, f"{__name__}:load_replay_buffer", replace=True)


def load_replay_buffer(
    dataset_id: str, *, batch_size: int = 256, slice_length: int | None = None, **options: Any
) -> Any:
    """Loads a dataset as a TorchRL replay buffer of its train split.

    Args:
        dataset_id: as of `swarmdata.load`.
        batch_size: number of transitions of a sample.
        slice_length: consecutive steps of one episode; None: single transitions.
        **options: of `swarmdata.load`.
    """
    return replay_buffer(load(dataset_id, **options).split("train"), batch_size, slice_length)
