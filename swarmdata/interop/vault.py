"""OG-MARL's Vault (Flashbax): one flat timeline per leaf, without an index of episodes.

Formanek et al. 2023, "Off-the-Grid MARL", and `flashbax.vault.Vault`. A vault's folder is
`<rel_dir>/<name>.vlt/<uid>`; its leaves are observations [B, T, N, O], actions, rewards,
terminals, truncations [B, T, N], infos.state [B, T, S] and infos.legals [B, T, N, C]. Flashbax
writes it, block by block, with separate terminals and truncations, and with
`infos.next_observations`, because a vault has no last observation. TensorStore reads it, block by
block: B timelines, whose episodes end where all agents have ended. Older data store time limits as
terminals; the user is asked.
"""

import contextlib
import io
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import ConversionError
from swarmdata.interop.conversion.dataset_facts import (
    NEXT_PREFIX,
    NOTED_FACTS,
    Arrays,
    step_blocks,
    time_keys,
)
from swarmdata.interop.conversion.export_note import (
    ExportNote,
    import_with_note,
    note_text,
    parse_note,
)
from swarmdata.interop.conversion.foreign_data import BlockReader, Timeline, import_without_note
from swarmdata.interop.conversion.foreign_file import check_stored, reading
from swarmdata.interop.conversion.foreign_rows import (
    agent_columns,
    columns_of,
    count_choices,
    flags_of,
)
from swarmdata.interop.conversion.imported_data import AgentShapes, ImportedData
from swarmdata.interop.conversion.user_choices import Choices
from swarmdata.interop.formats import Format
from swarmdata.runtime.documents import read_document
from swarmdata.runtime.extras import require_extra
from swarmdata.types import Bool

NOTE_KEY = "swarmdata"

QUIET_SECONDS = 0.5  # that the files of a failed export stay the same before they are removed
MAX_WAIT_SECONDS = 10.0  # for that

KEPT_NAMES = {
    "observations": "observations",
    "states": "infos.state",
    "actions": "actions",
    "rewards": "rewards",
    "terminations": "terminals",
    "truncations": "truncations",
    "alive": "infos.alive",
    "action_masks": "infos.legals",
    "agent_terminations": "infos.agent_terminals",
    "agent_truncations": "infos.agent_truncations",
    **dict.fromkeys(NOTED_FACTS, "metadata.json"),
}
LOST_REASONS = {
    **dict.fromkeys(
        ("sent", "delivered", "ages", "log_probs", "events", "reward_terms"),
        "OG-MARL would load them into memory and not use them",
    ),
    "layout": "it only has rows over time",
}

_TIME_KEYS = time_keys(KEPT_NAMES, lambda key: f"infos.{NEXT_PREFIX}{key.rpartition('.')[2]}")


def write(dataset: Dataset, path: Path, frame: str) -> None:
    """Writes a view as one vault; `path` is the folder of its uid."""
    require_extra("flashbax", "vault", "the Vault format")
    from flashbax.buffers.trajectory_buffer import TrajectoryBufferState  # noqa: PLC0415
    from flashbax.vault import Vault  # noqa: PLC0415  (an extra)

    vault = None
    for _, arrays in step_blocks(dataset):
        leaves = _leaves(arrays)
        n = len(arrays["actions"])
        with contextlib.redirect_stdout(io.StringIO()), _ended(path):  # it prints where it writes
            if vault is None:
                vault = Vault(
                    path.parent.name,
                    experience_structure=leaves,
                    rel_dir=str(path.parent.parent),
                    vault_uid=path.name,
                    metadata={NOTE_KEY: note_text(dataset, frame)},
                )
            state = TrajectoryBufferState(experience=leaves, current_index=n, is_full=False)
            vault.write(state, source_interval=(0, n))


@contextlib.contextmanager
def _ended(folder: Path) -> Iterator[None]:
    """Where a write fails, waits for TensorStore's threads, which would make the folder again."""
    try:
        yield
    except Exception:
        deadline, seen = time.monotonic() + MAX_WAIT_SECONDS, None
        while time.monotonic() < deadline:
            sizes = {}
            for file in folder.rglob("*"):
                with contextlib.suppress(FileNotFoundError):  # one may go meanwhile
                    sizes[file] = file.stat().st_size
            if sizes == seen:
                break
            seen = sizes
            time.sleep(QUIET_SECONDS)
        raise


def _leaves(arrays: Arrays) -> dict[str, Any]:
    """Rows as a vault's tree, [1, n, ...]; every agent gets the team's flags."""
    n_agents = arrays["rewards"].shape[1]
    tree: dict[str, Any] = {"infos": {}}
    for name, values in arrays.items():
        if name not in _TIME_KEYS:
            continue
        if name in ("terminations", "truncations"):
            values = np.repeat(values[:, None], n_agents, axis=1)  # noqa: PLW2901
        folder, _, leaf = _TIME_KEYS[name].rpartition(".")
        (tree[folder] if folder else tree)[leaf] = values[None]
    return tree


@contextlib.contextmanager
def read(source: Path, task: str, choices: Choices) -> Iterator[ImportedData]:
    """Opens the folder of a vault's uid, such as `3m.vlt/Good`."""
    try:
        metadata = read_document(source / "metadata.json")
        names = _names(metadata["structure_shape"])
    except (OSError, ValueError, LookupError, TypeError, AttributeError) as error:
        raise ConversionError(
            f"{source} is not the folder of a vault's uid, such as 3m.vlt/Good, with a "
            f"metadata.json of Flashbax: {error!r}"
        ) from error
    absent = {"observations", "actions", "rewards", "terminals"} - set(names)
    if absent:
        raise ConversionError(
            f"{source} lacks {sorted(absent)}: it has the leaves {names}, expected observations, "
            "actions, rewards and terminals"
        )
    leaves = {name: _open(source, f"{name}.") for name in names}
    with reading(source):
        n = int(_open(source, "vault_index")[:].read().result()[0])
    short = {name: leaf.shape for name, leaf in leaves.items() if (*leaf.shape, 0, 0)[1] < n}
    if n < 1 or short:
        raise ConversionError(
            f"{source} says that it has {n} rows, expected at least 1 and no more than its leaves "
            f"have{f': {short}' if short else ''}"
        )
    stored = sum(path.stat().st_size for path in source.rglob("*") if path.is_file())
    check_stored(source, n * _row_bytes(leaves), stored)
    if len(leaves["rewards"].shape) != 3 or len(leaves["observations"].shape) < 3:
        shapes = {name: leaves[name].shape for name in ("observations", "rewards")}
        raise ConversionError(f"{source} has leaves {shapes}, expected [B, T, N, O] and [B, T, N]")
    note = metadata.get(NOTE_KEY)
    if note is None:
        yield _read_foreign(leaves, n, source, task, choices)
    else:
        yield _read_exported(leaves, n, source, parse_note(note, source))


def _names(tree: Mapping[str, Any], prefix: str = "") -> list[str]:
    """Names of all leaves, joined by dots."""
    found = []
    for key, value in tree.items():
        found += _names(value, f"{prefix}{key}.") if isinstance(value, Mapping) else [prefix + key]
    return found


def _open(source: Path, name: str) -> Any:
    require_extra("tensorstore", "vault", "the Vault format")
    import tensorstore  # noqa: PLC0415  (an extra)

    store = {"driver": "ocdbt", "base": f"file://{source.resolve()}", "path": name}
    with reading(f"{source}: leaf {name!r}"):
        return tensorstore.open({"driver": "zarr", "kvstore": store}, read=True).result()


def _row_bytes(leaves: Mapping[str, Any]) -> int:
    sizes = (np.prod(leaf.shape[2:]) * leaf.dtype.numpy_dtype.itemsize for leaf in leaves.values())
    return int(sum(sizes))


def _rows(
    leaves: Mapping[str, Any], names: Mapping[str, str], timeline: int, window: slice
) -> dict[str, NDArray[Any]]:
    """Rows of some leaves, by our names, which are read at the same time."""
    pending = {name: leaves[key][timeline, window].read() for name, key in names.items()}
    return {name: np.asarray(each.result()) for name, each in pending.items()}


def _read_exported(
    leaves: Mapping[str, Any], n: int, source: Path, note: ExportNote
) -> ImportedData:
    names = {name: key for name, key in _TIME_KEYS.items() if key in leaves}

    def rows(window: slice) -> Arrays:
        found = _rows(leaves, names, 0, window)
        for name in ("terminations", "truncations"):
            found[name] = found[name][:, 0]
        return found

    return import_with_note(note, BlockReader(rows, n, _row_bytes(leaves), source), n, str(source))


def _read_foreign(
    leaves: Mapping[str, Any], n: int, source: Path, task: str, choices: Choices
) -> ImportedData:
    state = next((name for name in ("infos.state", "infos.states") if name in leaves), None)
    n_agents = leaves["rewards"].shape[2]
    names = {"observations": "observations", "actions": "actions", "rewards": "rewards"}
    if state is not None:
        names["states"] = state
    if "infos.next_observations" in leaves:
        names["next_observations"] = "infos.next_observations"
    counts: tuple[int, ...] = ()
    if leaves["actions"].dtype.numpy_dtype.kind in "iu":
        with reading(source):
            actions = np.asarray(leaves["actions"][:, 0:n].read().result())
        rows = actions.reshape(-1, *actions.shape[2:])
        counts = count_choices(agent_columns(rows, n_agents, f"{source}: actions"), str(source))
        if "infos.legals" in leaves:
            names["action_masks"] = "infos.legals"
            counts = (leaves["infos.legals"].shape[-1], *counts[1:])
    shapes = AgentShapes(
        observations=(columns_of(leaves["observations"].shape[2:]),) * n_agents,
        actions=(columns_of(leaves["actions"].shape[2:]),) * n_agents,
        choices=(counts,) * n_agents,
        states=0 if state is None else columns_of(leaves[state].shape[1:]),
    )
    timelines = [
        _timeline(leaves, n, names, source, row) for row in range(leaves["rewards"].shape[0])
    ]
    unread = set(leaves) - set(names.values()) - {"terminals", "truncations"}
    return import_without_note(task, shapes, timelines, choices, unread=sorted(unread))


def _timeline(
    leaves: Mapping[str, Any], n: int, names: Mapping[str, str], source: Path, row: int
) -> Timeline:
    """One of the B timelines of a vault."""
    where, n_agents = f"{source} (timeline {row})", leaves["rewards"].shape[2]

    def rows(window: slice) -> Arrays:
        found = _rows(leaves, names, row, window)
        for name in found.keys() & {"observations", "next_observations"}:
            values = found[name]  # padding is -inf in OMAR's data
            found[name] = np.where(np.isneginf(values), values.dtype.type(0), values)
        return found

    def flags(name: str) -> Bool:
        with reading(where):
            values = _rows(leaves, {name: name}, row, slice(0, n))[name]
        return flags_of(values, n_agents, f"{where}: {name}")

    ahead = BlockReader(rows, n, _row_bytes(leaves), where)
    truncations = flags("truncations") if "truncations" in leaves else None
    return Timeline(where, flags("terminals"), truncations, ahead, "next_observations" in names)


FORMAT = Format("vault", "OG-MARL Vault (Flashbax)", KEPT_NAMES, LOST_REASONS, read, write)
