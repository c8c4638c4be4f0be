"""TorchRL: a memory-mapped TensorDict of transitions with nested multi-agent keys.

There is one group, `agents`, with the agent axis after the batch axis, as in TorchRL's multi-agent
environments and BenchMARL: ("agents", "observation"), ("next", "agents", "reward"). `state` is for
critics; ("collector", "traj_ids") separates episodes, for `SliceSampler`. Next states are under
"next", so no transition is lost and none crosses episodes. `replay_buffer` makes a buffer of the
folder without copying. Such folders are read, as well as folders written by a replay buffer's
`dumps`, several groups, and batches [B, T] of a collector, whose trajectories are joined by their
ids. `Dataset.replay_buffer` makes a buffer without files; `register_torchrl` is for TorchRL's
`load_dataset`.
"""

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import ConversionError, MissingExtraError, SchemaError, SpecError
from swarmdata.hub.catalog.catalog import load
from swarmdata.interop.conversion.dataset_facts import (
    NOTED_FACTS,
    Arrays,
    recorded_agents,
    row_shapes,
    step_blocks,
    time_keys,
)
from swarmdata.interop.conversion.export_note import (
    NOTE_FILE,
    ExportNote,
    import_with_note,
    read_note,
    write_note,
)
from swarmdata.interop.conversion.foreign_data import BlockReader
from swarmdata.interop.conversion.foreign_file import reading
from swarmdata.interop.conversion.foreign_rows import check_lengths
from swarmdata.interop.conversion.imported_data import ImportedData
from swarmdata.interop.conversion.user_choices import Choices
from swarmdata.interop.formats import Format
from swarmdata.interop.torchrl.torchrl_foreign import TRAJECTORY_KEY, leaf_keys, read_foreign_rows
from swarmdata.registry.presets import find_spec
from swarmdata.runtime.documents import read_document
from swarmdata.runtime.extras import require_extra
from swarmdata.specs.spaces import DiscreteSpace
from swarmdata.specs.task_spec import TaskSpec

Key = tuple[str, ...]

_ARRAY_KEYS: dict[str, Key] = {
    "observations": ("agents", "observation"),
    "states": ("state",),
    "sent": ("agents", "sent"),
    "delivered": ("agents", "delivered"),
    "ages": ("agents", "message_ages"),
    "actions": ("agents", "action"),
    "log_probs": ("agents", "action_log_prob"),
    "rewards": ("next", "agents", "reward"),
    "reward_terms": ("next", "agents", "reward_terms"),
    "terminations": ("next", "terminated"),
    "truncations": ("next", "truncated"),
    "events": ("next", "agents", "events"),
    "alive": ("agents", "mask"),
    "action_masks": ("agents", "action_mask"),
    "agent_terminations": ("next", "agents", "terminated"),
    "agent_truncations": ("next", "agents", "truncated"),
}
_TIME_KEYS = time_keys(_ARRAY_KEYS, lambda key: ("next", *key))

_WITH_LAST_AXIS = frozenset(
    ("rewards", "terminations", "truncations", "agent_terminations", "agent_truncations")
)
"""Arrays that have a last axis of size 1 in TorchRL."""

_DONE_KEY: Key = ("next", "done")

_PICKLES = (".pickle", ".pkl", ".pt", ".pth")  # suffixes of files that Python or PyTorch would run

KEPT_NAMES = {
    **{name: ".".join(key) for name, key in _ARRAY_KEYS.items()},
    **dict.fromkeys(NOTED_FACTS, NOTE_FILE),
}
LOST_REASONS = {"layout": "it only has rows over time"}


def write(dataset: Dataset, path: Path, frame: str) -> None:
    """Writes a view as the folder of a memory-mapped TensorDict."""
    target = _layout(dataset).memmap_like(prefix=str(path))
    for file in path.rglob("*.memmap"):  # now: writing to one on a full disk would end the process
        if size := file.stat().st_size:
            with file.open("r+b") as opened:
                os.posix_fallocate(opened.fileno(), 0, size)
    _fill(target, dataset)
    write_note(dataset, path, frame)


def _layout(dataset: Dataset) -> Any:
    """Returns a TensorDict [n] of all keys whose rows are one row of zeros."""
    require_extra("tensordict", "torchrl", "the TorchRL format")
    import torch  # noqa: PLC0415  (an extra, and heavy)
    from tensordict import TensorDict  # noqa: PLC0415  (an extra)

    n, discrete = dataset.n_steps, _is_discrete(dataset)
    rows = TensorDict({}, [n])
    for name, (shape, dtype) in row_shapes(dataset).items():
        row = _like_theirs(name, np.zeros((1, *shape), dtype), discrete)
        rows[_TIME_KEYS[name]] = torch.from_numpy(row).expand(n, *row.shape[1:])
    rows[_DONE_KEY] = torch.zeros(1, dtype=torch.bool).expand(n, 1)
    rows[TRAJECTORY_KEY] = torch.zeros(1, dtype=torch.int64).expand(n)
    return rows


def _is_discrete(dataset: Dataset) -> bool:
    """Whether every agent has one discrete action: TorchRL stores these as integers [n, N]."""
    agents = recorded_agents(dataset.spec, dataset.stored.arrays["observations"].shape[2])
    return all(isinstance(agent.action, DiscreteSpace) for agent in agents)


def _fill(target: Any, dataset: Dataset) -> None:
    """Writes the rows of a view into a TensorDict of its `_layout`."""
    import torch  # noqa: PLC0415  (an extra, and heavy)

    discrete = _is_discrete(dataset)
    trajectories = np.repeat(np.arange(len(dataset)), dataset.episodes.lengths)
    for first, arrays in step_blocks(dataset):
        rows = slice(first, first + len(arrays["actions"]))
        for name, values in arrays.items():
            theirs = _like_theirs(name, values, discrete)
            target[_TIME_KEYS[name]][rows] = torch.from_numpy(theirs)
        ended = arrays["terminations"] | arrays["truncations"]
        target[_DONE_KEY][rows] = torch.from_numpy(ended[:, None])
        target[TRAJECTORY_KEY][rows] = torch.from_numpy(trajectories[rows])


def _like_theirs(name: str, values: NDArray[Any], discrete: bool) -> NDArray[Any]:
    if name == "actions" and discrete:
        return values[..., 0].astype(np.int64)
    return np.ascontiguousarray(values[..., None] if name in _WITH_LAST_AXIS else values)


def replay_buffer(
    source: "Dataset | Path | str",
    batch_size: int | None,
    slice_length: int | None = None,
    keys: Sequence[Key | str] | None = None,
) -> Any:
    """Makes a TorchRL replay buffer of a dataset in memory, or of a converted folder uncopied.

    Args:
        source: a view of a dataset; or a folder of one that was converted to this format.
        batch_size: number of transitions of a sample; None: `sample` is told it each time.
        slice_length: samples consist of so many consecutive steps of one episode; a divisor of
            `batch_size`. None: single transitions.
        keys: of samples, such as those of an environment whose transitions are to be sampled
            along. None: all, and `index`.

    Raises:
        MissingExtraError: TorchRL is not installed.
        SchemaError: the view has no episodes, or the transitions lack a key.
    """
    for package in ("tensordict", "torchrl"):
        require_extra(package, "torchrl", "a replay buffer")
    from torchrl import data  # noqa: PLC0415  (an extra)

    if isinstance(source, Dataset):
        if not len(source):
            raise SchemaError(f"{source!r} has no episodes to sample from; widen its filter")
        rows = _layout(source).clone()
        _fill(rows, source)
    else:
        rows = _map(Path(source))
    if keys is not None:
        wanted = [(key,) if isinstance(key, str) else tuple(key) for key in keys]
        if lacking := [key for key in wanted if key not in leaf_keys(rows)]:
            raise SchemaError(
                f"the transitions have no keys {lacking}; they have {sorted(leaf_keys(rows))}. Ask "
                "for these."
            )
        rows = rows.select(*wanted, *([] if slice_length is None else [TRAJECTORY_KEY]))
    sampler = data.RandomSampler()
    if slice_length is not None:
        sampler = data.SliceSampler(slice_len=slice_length, traj_key=TRAJECTORY_KEY)
    # the first kind adds `index`
    kind = data.TensorDictReplayBuffer if keys is None else data.ReplayBuffer
    return kind(storage=data.TensorStorage(rows), sampler=sampler, batch_size=batch_size)


@contextmanager
def read(source: Path, task: str, choices: Choices) -> Iterator[ImportedData]:
    """Opens the folder of a memory-mapped TensorDict, or one of a replay buffer's `dumps`."""
    rows = _load(source)
    if (note := read_note(source)) is not None:
        yield _read_exported(rows, source, note)
    else:
        yield read_foreign_rows(rows, source, task, choices)


def _map(folder: Path) -> Any:
    """Maps a TensorDict; tensordict would run what a pickle beside its tensors says."""
    require_extra("tensordict", "torchrl", "the TorchRL format")
    from tensordict import TensorDict  # noqa: PLC0415  (an extra)

    if pickles := sorted(path for path in folder.rglob("*") if path.suffix in _PICKLES):
        raise ConversionError(
            f"{pickles[0]} is a pickle, which would run as a program when it is read, expected "
            "tensors alone. Save the TensorDict without other objects."
        )
    with reading(folder, "It is damaged, or not a memory-mapped TensorDict."):
        return TensorDict.load_memmap(str(folder))


def _load(source: Path) -> Any:
    storage = source / "storage"
    folder = storage if storage.is_dir() else source
    if not (folder / "meta.json").is_file():
        raise ConversionError(f"{source} has no meta.json, so it is not a memory-mapped TensorDict")
    rows = _map(folder)
    counted = folder / "storage_metadata.json"
    if counted.is_file():  # a storage has room for more rows than were written
        try:
            rows = rows[: int(read_document(counted)["len"])]
        except (OSError, ValueError, TypeError, LookupError) as error:
            raise ConversionError(
                f"{counted} does not have the storage's length, `len`: {error!r}"
            ) from error
    return rows


def _read_exported(rows: Any, source: Path, note: ExportNote) -> ImportedData:
    stored = leaf_keys(rows)
    names = {name: key for name, key in _TIME_KEYS.items() if key in stored}

    def get(window: slice) -> Arrays:
        return {name: _like_ours(name, rows[key][window].numpy()) for name, key in names.items()}

    with reading(source):
        check_lengths({".".join(key): len(rows[key]) for key in names.values()}, str(source))
        row_bytes = sum(rows[key][:1].numpy().nbytes for key in names.values())
    read = BlockReader(get, len(rows), row_bytes, source)
    return import_with_note(note, read, len(rows), str(source))


def _like_ours(name: str, values: NDArray[Any]) -> NDArray[Any]:
    if name in _WITH_LAST_AXIS:
        return values[..., 0]
    if name == "actions" and values.dtype.kind == "i":
        return values[..., None].astype(np.float32)
    return values


FORMAT = Format("torchrl", "TorchRL TensorDict", KEPT_NAMES, LOST_REASONS, read, write)


PREFIX = "swarmdata"  # what names of this library's datasets begin with in TorchRL, before a colon


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
    """Loads the train split of `swarmdata.load(dataset_id, **options)` as `replay_buffer`."""
    return replay_buffer(load(dataset_id, **options).split("train"), batch_size, slice_length, keys)
