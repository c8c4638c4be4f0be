"""TorchRL: a memory-mapped TensorDict of transitions with nested multi-agent keys.

One group, `agents`, with the agent axis behind the batch axis, as TorchRL's multi-agent
environments and BenchMARL have it ("agents", "observation") and ("next", "agents", "reward");
`state` for critics; ("collector", "traj_ids") tells episodes apart, for `SliceSampler`. What was
reached lies under "next", so no transition is lost and none crosses episodes. `replay_buffer` makes
a buffer of it without copying. Read: such folders, folders that a replay buffer's `dumps` wrote,
several groups, and batches [B, T] of a collector; whole trajectories are put together by their ids.
"""

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import ConversionError, MissingExtraError
from swarmdata.interop.conversion.incoming import Incoming
from swarmdata.interop.conversion.kept_facts import (
    NEXT,
    STATE_ARRAYS,
    TIME_ARRAYS,
    blocks,
    row_shapes,
)
from swarmdata.interop.conversion.note import Note, note_of, parse_note
from swarmdata.interop.conversion.noted_data import noted
from swarmdata.interop.conversion.read_ahead import Ahead
from swarmdata.interop.conversion.space_columns import agents_of
from swarmdata.interop.conversion.user_choices import Choices
from swarmdata.interop.formats import Format
from swarmdata.interop.torchrl.torchrl_foreign import unnoted_rows
from swarmdata.runtime.documents import read_document
from swarmdata.specs.spaces import DiscreteSpace

NOTE = "swarmdata.json"

Key = tuple[str, ...]

_KEYS: dict[str, Key] = {
    "observations": ("agents", "observation"),
    "states": ("state",),
    "sent": ("agents", "sent"),
    "delivered": ("agents", "delivered"),
    "ages": ("agents", "message_ages"),
    "actions": ("agents", "action"),
    "log_probs": ("agents", "action_log_prob"),
    "rewards": ("next", "agents", "reward"),
    "terminations": ("next", "terminated"),
    "truncations": ("next", "truncated"),
    "events": ("next", "agents", "events"),
    "alive": ("agents", "mask"),
    "action_masks": ("agents", "action_mask"),
    "agent_terminations": ("next", "agents", "terminated"),
    "agent_truncations": ("next", "agents", "truncated"),
}
_WITH_LAST_AXIS = frozenset(
    ("rewards", "terminations", "truncations", "agent_terminations", "agent_truncations")
)
"""TorchRL gives rewards and ends an axis of 1 at the end."""

_TRAJECTORY: Key = ("collector", "traj_ids")
_DONE: Key = ("next", "done")

KEPT = {
    **{name: ".".join(key) for name, key in _KEYS.items()},
    **dict.fromkeys(("seed", "policy", "end_reason", "split", "spec"), NOTE),
}
LOST = {"layout": "it only has rows over time"}


def _library() -> Any:
    try:
        import tensordict  # noqa: PLC0415  (an extra)
    except ImportError as error:
        raise MissingExtraError("tensordict", "torchrl", "the TorchRL format") from error
    return tensordict


def write(dataset: Dataset, path: Path) -> None:
    """Writes a view as the folder of a memory-mapped TensorDict."""
    tensordict = _library()
    import torch  # noqa: PLC0415  (an extra, and heavy)

    discrete = _is_discrete(dataset)
    n = dataset.n_steps
    empty: dict[str, Any] = {}
    shapes = {name: _like_theirs(name, np.zeros((1, *shape), dtype), discrete)
              for name, (shape, dtype) in row_shapes(dataset).items() if _key(name)}  # fmt: skip
    for name, row in shapes.items():
        _put(empty, _key(name) or (), torch.from_numpy(row).expand(n, *row.shape[1:]))
    _put(empty, _DONE, torch.zeros(1, dtype=torch.bool).expand(n, 1))
    _put(empty, _TRAJECTORY, torch.zeros(1, dtype=torch.int64).expand(n))
    target = tensordict.TensorDict(empty, [n]).memmap_like(prefix=str(path))
    _reserve(path)
    trajectories = np.repeat(np.arange(len(dataset)), dataset.episodes.lengths)
    for first, arrays in blocks(dataset):
        rows = slice(first, first + len(arrays["actions"]))
        for name, values in arrays.items():
            if name in shapes:
                theirs = _like_theirs(name, values, discrete)
                target[_key(name)][rows] = torch.from_numpy(theirs)
        ended = arrays["terminations"] | arrays["truncations"]
        target[_DONE][rows] = torch.from_numpy(ended[:, None])
        target[_TRAJECTORY][rows] = torch.from_numpy(trajectories[rows])
    (path / NOTE).write_text(note_of(dataset).to_json(), encoding="utf-8")


def _reserve(folder: Path) -> None:
    """Takes the space of every map now: on a full disk, writing to one ends the process."""
    for file in folder.rglob("*.memmap"):
        if size := file.stat().st_size:
            with file.open("r+b") as opened:
                os.posix_fallocate(opened.fileno(), 0, size)


def _is_discrete(dataset: Dataset) -> bool:
    """Whether every agent has one discrete action: TorchRL then has whole numbers, [n, N]."""
    agents = agents_of(dataset.spec, dataset.stored.arrays["observations"].shape[2])
    return all(isinstance(agent.action, DiscreteSpace) for agent in agents)


def _key(name: str) -> Key | None:
    if not name.startswith(NEXT):
        return _KEYS.get(name)
    key = _KEYS.get(name.removeprefix(NEXT))
    return None if key is None else ("next", *key)


def _put(tree: dict[str, Any], key: Key, value: Any) -> None:
    for part in key[:-1]:
        tree = tree.setdefault(part, {})
    tree[key[-1]] = value


def _like_theirs(name: str, values: NDArray[Any], discrete: bool) -> NDArray[Any]:
    if name == "actions" and discrete:
        return values[..., 0].astype(np.int64)
    return np.ascontiguousarray(values[..., None] if name in _WITH_LAST_AXIS else values)


def replay_buffer(path: Path | str, batch_size: int, slice_length: int | None = None) -> Any:
    """Makes a TorchRL replay buffer of a converted dataset; nothing is copied.

    Args:
        path: folder that `write` made.
        batch_size: transitions of a sample.
        slice_length: consecutive steps of one episode that a sample is made of, a divisor of
            `batch_size`; None for single transitions.

    Raises:
        MissingExtraError: TorchRL is not installed.
    """
    tensordict = _library()
    try:
        from torchrl.data import (  # noqa: PLC0415  (an extra)
            RandomSampler,
            SliceSampler,
            TensorDictReplayBuffer,
            TensorStorage,
        )
    except ImportError as error:
        raise MissingExtraError("torchrl", "torchrl", "a replay buffer") from error
    rows = tensordict.TensorDict.load_memmap(str(path))
    sampler = RandomSampler()
    if slice_length is not None:
        sampler = SliceSampler(slice_len=slice_length, traj_key=_TRAJECTORY)
    return TensorDictReplayBuffer(
        storage=TensorStorage(rows), sampler=sampler, batch_size=batch_size
    )


@contextmanager
def read(source: Path, task: str, choices: Choices) -> Iterator[Incoming]:
    """Opens the folder of a memory-mapped TensorDict, or one that a replay buffer's `dumps` wrote.

    Raises:
        ConversionError: it is no such folder, lacks keys, or is ambiguous.
    """
    rows = _load(source)
    note = source / NOTE
    if note.is_file():
        yield _noted(rows, source, parse_note(note.read_bytes(), note))
    else:
        yield unnoted_rows(rows, source, task, choices)


def _load(source: Path) -> Any:
    tensordict = _library()
    storage = source / "storage"
    folder = storage if storage.is_dir() else source
    if not (folder / "meta.json").is_file():
        raise ConversionError(f"{source} has no meta.json, so it is no memory-mapped TensorDict")
    rows = tensordict.TensorDict.load_memmap(str(folder))
    counted = folder / "storage_metadata.json"
    if counted.is_file():  # a storage has room for more rows than were written
        rows = rows[: _length(counted)]
    return rows


def _length(file: Path) -> int:
    """Rows of a storage that were written.

    Raises:
        ConversionError: its note is damaged.
    """
    try:
        return int(read_document(file)["len"])
    except (OSError, ValueError, TypeError, LookupError) as error:
        raise ConversionError(f"{file} does not say the storage's `len`: {error!r}") from error


def _noted(rows: Any, source: Path, note: Note) -> Incoming:
    there = rows.keys(include_nested=True, leaves_only=True)
    there = {key if isinstance(key, tuple) else (key,) for key in there}
    names = {name: key for name in TIME_ARRAYS if (key := _key(name)) in there}
    names |= {NEXT + k: key for k in STATE_ARRAYS if (key := _key(NEXT + k)) in there}

    def get(window: slice) -> Mapping[str, NDArray[Any]]:
        return {name: _like_ours(name, rows[key][window].numpy()) for name, key in names.items()}

    row_bytes = sum(rows[key][:1].numpy().nbytes for key in names.values())
    return noted(note, Ahead(get, len(rows), row_bytes), len(rows), str(source))


def _like_ours(name: str, values: NDArray[Any]) -> NDArray[Any]:
    if name in _WITH_LAST_AXIS:
        return values[..., 0]
    if name == "actions" and values.dtype.kind == "i":
        return values[..., None].astype(np.float32)
    return values


FORMAT = Format("torchrl", "TorchRL TensorDict", KEPT, LOST, read, write)
