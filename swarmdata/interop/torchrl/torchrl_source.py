"""Datasets and worlds in TorchRL.

swarmdata.register_torchrl()
buffer = torchrl.data.datasets.load_dataset("swarmdata:coop_nav-medium", batch_size=256)
env = swarmdata.make_torchrl_env(swarmdata.preset("coop_nav"), 64)
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from swarmdata.errors import MissingExtraError, SpecError
from swarmdata.hub.catalog.catalog import load
from swarmdata.interop.torchrl.torchrl import Key, replay_buffer
from swarmdata.registry.presets import find_spec
from swarmdata.runtime.extras import require_extra
from swarmdata.specs.task_spec import TaskSpec

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


def make_torchrl_env(
    spec: TaskSpec | Path | str, n_copies: int = 1, *, seed: int | None = None
) -> Any:
    """Makes copies of a task as one environment of TorchRL, with the keys of our replay buffers.

    The batch is [E]: `n_copies` copies that are stepped together, on the CPU. A copy that has ended
    is not reset by itself; TorchRL's collectors and `rollout(..., break_when_any_done=False)` do.

    Args:
        spec: the task; or a preset's name, or a spec file.
        n_copies: number of copies, E.
        seed: of all episodes, none of which is reserved for evaluation; drawn if None.

    Raises:
        MissingExtraError: TorchRL is not installed.
        SpecError: the number of copies is not positive.
    """
    for package in ("torchrl", "tensordict"):
        require_extra(package, "torchrl", "make_torchrl_env")
    if n_copies < 1:
        raise SpecError(f"n_copies is {n_copies}, expected at least 1")
    from swarmdata.interop.torchrl.torchrl_world import TorchRLWorld  # noqa: PLC0415  (an extra)

    return TorchRLWorld(find_spec(spec), n_copies, seed)


def load_replay_buffer(
    dataset_id: str,
    *,
    batch_size: int = 256,
    slice_length: int | None = None,
    keys: Sequence[Key | str] | None = None,
    **options: Any,
) -> Any:
    """Loads a dataset as a TorchRL replay buffer of its train split.

    Args:
        dataset_id: as of `swarmdata.load`.
        batch_size: number of transitions of a sample.
        slice_length: consecutive steps of one episode; None: single transitions.
        keys: to sample; None: all.
        **options: of `swarmdata.load`.
    """
    return replay_buffer(load(dataset_id, **options).split("train"), batch_size, slice_length, keys)
