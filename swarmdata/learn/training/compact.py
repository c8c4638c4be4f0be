"""Makes the checkpoint of a finished run small: it keeps what policies are made of.

That is found by trying: a tensor that can be exchanged for that of an untrained algorithm without
changing any policy is not needed. Policies are compared field by field, as dataclasses; those of an
algorithm of one's own that are none keep the whole checkpoint.
"""

from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from swarmdata.errors import CheckpointError
from swarmdata.interfaces import Algorithm
from swarmdata.learn.training.checkpoint import load_checkpoint, part, save_checkpoint
from swarmdata.learn.training.run_files import CHECKPOINT
from swarmdata.learn.training.run_folder import (
    COMPACT,
    read_run,
    restore,
    statistics_of,
    tensors_of,
)


def compact(folder: Path) -> None:
    """Replaces the checkpoint of a finished run by one of its policies; `load_run` reads both.

    The run cannot be trained any further. Killed in the middle, it can be called again.
    """
    run = read_run(folder)
    tensors, metadata = load_checkpoint(folder / CHECKPOINT)
    if metadata.get(COMPACT):
        return
    if metadata["update"] < run.config["n_updates"]:
        raise CheckpointError(
            f"{folder} is at update {metadata['update']} of {run.config['n_updates']}; finish it "
            "before its checkpoint is made small"
        )
    statistics, state = statistics_of(tensors), part(tensors, "algorithm")
    algorithm = run.build(statistics, "cpu")
    blank = algorithm.state_dict()
    algorithm.load_state_dict(state)
    policies = [algorithm.policy(index) for index in range(len(run.seeds))]
    if not is_same([algorithm.policy(index) for index in range(len(run.seeds))], policies):
        return  # two of the same seed differ, so there is nothing to compare by
    kept = {k: v for k, v in state.items() if not _is_spare(k, state, blank, algorithm, policies)}
    algorithm = run.build(statistics, "cpu")
    restore(algorithm, kept, is_compact=True)
    if not is_same([algorithm.policy(index) for index in range(len(run.seeds))], policies):
        raise CheckpointError(
            f"{folder}: the policies of {run.algorithm} cannot be made from fewer tensors than the "
            f"checkpoint has, though each of {sorted(set(state) - set(kept))} alone seems spare"
        )
    named = {f"algorithm.{name}": tensor for name, tensor in kept.items()}
    save_checkpoint(
        folder / CHECKPOINT, {**named, **tensors_of(statistics)}, {**metadata, COMPACT: True}
    )


def _is_spare(
    name: str,
    state: Mapping[str, Any],
    blank: Mapping[str, Any],
    algorithm: Algorithm,
    policies: Sequence[Any],
) -> bool:
    """Whether policies are the same with a tensor of an untrained algorithm in this one's place.

    A tensor that an untrained algorithm does not have yet, such as a moment of Adam, is kept.
    """
    if name not in blank:
        return False
    algorithm.load_state_dict({**state, name: blank[name]})
    return is_same([algorithm.policy(index) for index in range(len(policies))], policies)


def is_same(one: Any, other: Any) -> bool:
    """Whether two policies, or parts of them, hold the same bits."""
    if isinstance(one, Tensor):
        return isinstance(other, Tensor) and torch.equal(one, other)
    if is_dataclass(one) and type(one) is type(other):
        names = [field.name for field in fields(one) if field.init]
        return all(is_same(getattr(one, name), getattr(other, name)) for name in names)
    if isinstance(one, list | tuple) and isinstance(other, list | tuple):
        return len(one) == len(other) and all(map(is_same, one, other))
    return bool(one == other)
