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
from swarmdata.errors import ConversionError, MissingExtraError
from swarmdata.interop.conversion.block_reader import BlockReader
from swarmdata.interop.conversion.dataset_facts import (
    NEXT_PREFIX,
    STATE_ARRAYS,
    TIME_ARRAYS,
    step_blocks,
)
from swarmdata.interop.conversion.episode_cuts import Timeline
from swarmdata.interop.conversion.export_note import ExportNote, note_of, parse_note
from swarmdata.interop.conversion.exported_data import import_with_note
from swarmdata.interop.conversion.foreign_data import import_without_note
from swarmdata.interop.conversion.imported_data import AgentShapes, ImportedData
from swarmdata.interop.conversion.user_choices import Choices
from swarmdata.interop.formats import Format
from swarmdata.runtime.documents import read_document

NOTE_KEY = "swarmdata"

QUIET_SECONDS = 0.5
"""How long the files of a failed export must stay the same before they are removed."""

MAX_WAIT_SECONDS = 10.0
"""How long to wait for that."""

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
    **dict.fromkeys(("seed", "policy", "end_reason", "split", "spec"), "metadata.json"),
}
LOST_REASONS = {
    **dict.fromkeys(
        ("sent", "delivered", "ages", "log_probs", "events", "reward_terms"),
        "OG-MARL would load them into memory and not use them",
    ),
    "layout": "it only has rows over time",
}


def write(dataset: Dataset, path: Path, frame: str) -> None:
    """Writes a view as one vault; `path` is the folder of its uid."""
    try:
        from flashbax.buffers.trajectory_buffer import TrajectoryBufferState  # noqa: PLC0415
        from flashbax.vault import Vault  # noqa: PLC0415  (an extra)
    except ImportError as error:
        raise MissingExtraError("flashbax", "vault", "the Vault format") from error
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
                    metadata={NOTE_KEY: note_of(dataset, frame).to_json()},
                )
            state = TrajectoryBufferState(experience=leaves, current_index=n, is_full=False)
            vault.write(state, source_interval=(0, n))


@contextlib.contextmanager
def _ended(folder: Path) -> Iterator[None]:
    """Waits, where a write fails, until TensorStore's threads have ended those of other leaves.

    Flashbax keeps no handle of them, and they would make again the folder that the caller removes.
    """
    try:
        yield
    except Exception:
        deadline, seen = time.monotonic() + MAX_WAIT_SECONDS, None
        while (now := _sizes(folder)) != seen and time.monotonic() < deadline:
            seen = now
            time.sleep(QUIET_SECONDS)
        raise


def _sizes(folder: Path) -> dict[str, int]:
    """Bytes of each file; one that goes meanwhile has none."""
    found = {}
    for file in folder.rglob("*"):
        with contextlib.suppress(FileNotFoundError):
            found[str(file)] = file.stat().st_size
    return found


def _leaves(arrays: Mapping[str, NDArray[Any]]) -> dict[str, Any]:
    """Rows as a vault's tree, [1, n, ...]; every agent gets the team's flags."""
    n_agents = arrays["rewards"].shape[1]
    tree: dict[str, Any] = {"infos": {}}
    for name, values in arrays.items():
        key = _key(name)
        if key is None:
            continue
        if name in ("terminations", "truncations"):
            values = np.repeat(values[:, None], n_agents, axis=1)  # noqa: PLW2901
        folder, _, leaf = key.rpartition(".")
        (tree[folder] if folder else tree)[leaf] = values[None]
    return tree


def _key(name: str) -> str | None:
    if not name.startswith(NEXT_PREFIX):
        return KEPT_NAMES.get(name)
    key = KEPT_NAMES.get(name.removeprefix(NEXT_PREFIX))
    return None if key is None else f"infos.{NEXT_PREFIX}{key.rpartition('.')[2]}"


@contextlib.contextmanager
def read(source: Path, task: str, choices: Choices) -> Iterator[ImportedData]:
    """Opens the folder of a vault's uid, such as `3m.vlt/Good`.

    Raises:
        ConversionError: it is no such folder, or is ambiguous.
    """
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
    n = int(_open(source, "vault_index")[:].read().result()[0])
    note = metadata.get(NOTE_KEY)
    if note is None:
        yield _read_foreign(leaves, n, source, task, choices)
    else:
        yield _read_exported(leaves, n, source, parse_note(note, source))


def _names(tree: Mapping[str, Any], prefix: str = "") -> list[str]:
    """Names of all leaves, joined by dots."""
    found = []
    for key, value in tree.items():
        inner = _names(value, f"{prefix}{key}.") if isinstance(value, Mapping) else [prefix + key]
        found += inner
    return found


def _open(source: Path, name: str) -> Any:
    try:
        import tensorstore  # noqa: PLC0415  (an extra)
    except ImportError as error:
        raise MissingExtraError("tensorstore", "vault", "the Vault format") from error
    store = {"driver": "ocdbt", "base": f"file://{source.resolve()}", "path": name}
    try:
        return tensorstore.open({"driver": "zarr", "kvstore": store}, read=True).result()
    except ValueError as error:
        raise ConversionError(f"{source} has no leaf {name!r} that can be read: {error}") from error


def _row_bytes(leaves: Mapping[str, Any]) -> int:
    return int(sum(np.prod(leaf.shape[2:]) * leaf.dtype.numpy_dtype.itemsize
                   for leaf in leaves.values()))  # fmt: skip


def _read_exported(
    leaves: Mapping[str, Any], n: int, source: Path, note: ExportNote
) -> ImportedData:
    all_names = (*TIME_ARRAYS, *(NEXT_PREFIX + name for name in STATE_ARRAYS))
    names = {name: key for name in all_names if (key := _key(name)) and key in leaves}

    def rows(window: slice) -> Mapping[str, NDArray[Any]]:
        pending = {name: leaves[key][0, window].read() for name, key in names.items()}
        found = {name: np.asarray(each.result()) for name, each in pending.items()}
        for name in ("terminations", "truncations"):
            found[name] = found[name][:, 0]
        return found

    return import_with_note(note, BlockReader(rows, n, _row_bytes(leaves)), n, str(source))


def _read_foreign(
    leaves: Mapping[str, Any], n: int, source: Path, task: str, choices: Choices
) -> ImportedData:
    is_discrete = leaves["actions"].dtype.numpy_dtype.kind in "iu"
    state = next((name for name in ("infos.state", "infos.states") if name in leaves), None)
    n_rows, n_agents = leaves["rewards"].shape[0], leaves["rewards"].shape[2]
    timelines = [_timeline(leaves, n, source, row, state) for row in range(n_rows)]
    legals = leaves.get("infos.legals") if is_discrete else None
    n_choices = 0
    if is_discrete:
        if legals is not None:
            n_choices = legals.shape[-1]
        else:
            n_choices = int(np.asarray(leaves["actions"][:, 0:n].read().result()).max()) + 1
    state_size = 0 if state is None else int(np.prod(leaves[state].shape[2:]))
    shapes = AgentShapes(
        observations=(int(np.prod(leaves["observations"].shape[3:])),) * n_agents,
        actions=(int(np.prod(leaves["actions"].shape[3:])),) * n_agents,
        choices=n_choices,
        states=state_size,
    )
    return import_without_note(task, shapes, timelines, choices)


def _timeline(
    leaves: Mapping[str, Any], n: int, source: Path, row: int, state: str | None
) -> Timeline:
    """One of the B timelines of a vault."""
    next_key = next((k for k in ("infos.next_observations",) if k in leaves), None)
    names = {"observations": "observations", "actions": "actions", "rewards": "rewards"}
    if state is not None:
        names["states"] = state
    if leaves["actions"].dtype.numpy_dtype.kind in "iu" and "infos.legals" in leaves:
        names["action_masks"] = "infos.legals"
    if next_key is not None:
        names["next_observations"] = next_key

    def rows(window: slice) -> Mapping[str, NDArray[Any]]:
        pending = {name: leaves[key][row, window].read() for name, key in names.items()}
        found = {name: np.asarray(each.result()) for name, each in pending.items()}
        return {name: _like_ours(name, values) for name, values in found.items()}

    def flags(name: str) -> NDArray[np.bool_]:
        return np.asarray(leaves[name][row, 0:n].read().result()) != 0

    ahead = BlockReader(rows, n, _row_bytes(leaves))
    truncations = flags("truncations") if "truncations" in leaves else None
    where = f"{source} (timeline {row})"
    return Timeline(where, flags("terminals"), truncations, ahead, next_key is not None)


def _like_ours(name: str, values: NDArray[Any]) -> NDArray[Any]:
    """Converts to the shape and dtype of our field; padding of -inf becomes zeros."""
    if name == "action_masks":
        return values != 0
    if name == "states":
        return values.reshape(len(values), -1).astype(np.float32)
    if name == "rewards":
        return values.astype(np.float32)
    rows = values.reshape(len(values), values.shape[1], -1).astype(np.float32)
    return np.where(np.isneginf(rows), np.float32(0), rows)


FORMAT = Format("vault", "OG-MARL Vault (Flashbax)", KEPT_NAMES, LOST_REASONS, read, write)
