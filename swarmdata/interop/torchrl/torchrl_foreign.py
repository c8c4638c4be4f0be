"""Reads TensorDicts that TorchRL, BenchMARL or others in their style collected."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmdata.errors import ConversionError
from swarmdata.interop.conversion.dataset_facts import Arrays
from swarmdata.interop.conversion.foreign_data import (
    BlockReader,
    ReadRows,
    Timeline,
    import_without_note,
)
from swarmdata.interop.conversion.foreign_rows import (
    agent_columns,
    count_choices,
    flags_of,
    pad_agents,
    share_choices,
)
from swarmdata.interop.conversion.imported_data import AgentShapes, ImportedData
from swarmdata.interop.conversion.user_choices import Choices
from swarmdata.types import Bool, Int

TRAJECTORY_KEY = ("collector", "traj_ids")


@dataclass(frozen=True, slots=True)
class _Group:
    """Agents that share tensors; `name` is empty for a single agent at the root."""

    name: tuple[str, ...]
    n_agents: int
    n_columns: int  # of an observation
    action_size: int


def read_foreign_rows(rows: Any, source: Path, task: str, choices: Choices) -> ImportedData:
    """Imports transitions [n] or [B, T] that this library did not write."""
    if rows.batch_dims == 2:
        rows = rows.reshape(-1) if TRAJECTORY_KEY in leaf_keys(rows) else _with_rows(rows)
    if rows.batch_dims != 1:
        raise ConversionError(f"{source} has batch size {tuple(rows.batch_size)}, expected [n]")
    if not len(rows):
        raise ConversionError(f"{source} has no rows, expected at least 1")
    groups = _groups(rows, source)
    order, terminals, truncations = _ends(rows, groups, source, choices)
    read, keys = _reader(rows, groups, order)
    row_bytes = sum(4 * g.n_agents * (2 * g.n_columns + g.action_size + 1) for g in groups)
    reader = BlockReader(read, len(order), row_bytes, source)
    timeline = Timeline(str(source), terminals, truncations, reader, has_next=True)
    counts: list[tuple[int, ...]] = []
    for group in groups:
        key = (*group.name, "action")
        actions = _numpy(rows, key).reshape(len(rows), group.n_agents, -1)
        counts += [count_choices(actions, f"{source}: {'.'.join(key)}")] * group.n_agents
    shapes = AgentShapes(
        observations=tuple(g.n_columns for g in groups for _ in range(g.n_agents)),
        actions=tuple(g.action_size for g in groups for _ in range(g.n_agents)),
        choices=share_choices(counts),
        states=rows["state"].shape[1:].numel() if ("state",) in keys else 0,
    )
    read_keys = keys | {TRAJECTORY_KEY, ("next", "done")}
    read_keys |= {key for key in leaf_keys(rows) if key[-1] in ("terminated", "truncated", "done")}
    unread = [".".join(key) for key in leaf_keys(rows) - read_keys]
    return import_without_note(task, shapes, [timeline], choices, unread=unread)


def _with_rows(rows: Any) -> Any:
    """Flattens [B, T]; each of the B rows becomes a trajectory."""
    import torch  # noqa: PLC0415  (an extra)

    n_rows, n_steps = rows.batch_size
    flat = rows.reshape(-1)
    flat[TRAJECTORY_KEY] = torch.arange(n_rows).repeat_interleave(n_steps)
    return flat


def leaf_keys(rows: Any) -> set[tuple[str, ...]]:
    """Keys of all leaves of a TensorDict, as tuples."""
    found = rows.keys(include_nested=True, leaves_only=True)
    return {key if isinstance(key, tuple) else (key,) for key in found}


def _numpy(rows: Any, key: tuple[str, ...]) -> NDArray[Any]:
    values: NDArray[Any] = rows[key].numpy()
    return values


def _groups(rows: Any, source: Path) -> list[_Group]:
    """The groups in the order of their names, or a single agent."""
    keys = leaf_keys(rows)
    names = sorted({key[:-1] for key in keys if key[-1] == "action" and key[0] != "next"})
    if not names:
        raise ConversionError(
            f"{source} has keys {sorted(keys)}, expected for example ('agents', 'action')"
        )
    groups = []
    for name in names:
        needed = [(*name, "observation"), ("next", *name, "observation")]
        absent = [key for key in needed if key not in keys]
        if absent:
            raise ConversionError(f"{source} lacks the keys {absent} of group {name}")
        observation, action = rows[(*name, "observation")], rows[(*name, "action")]
        n_agents = observation.shape[1] if name else 1
        sizes = (values.shape[1:].numel() // n_agents for values in (observation, action))
        groups.append(_Group(name, n_agents, *sizes))
    return groups


def _flags(rows: Any, groups: Sequence[_Group], name: str, source: Path) -> Bool | None:
    """A flag of each agent in each row, [n, N]; a team's flag counts for every agent."""
    columns, stored = [], leaf_keys(rows)
    for group in groups:
        keys = [("next", *group.name, name), ("next", name)]
        key = next((key for key in keys if key in stored), None)
        if key is None:
            return None
        columns.append(flags_of(_numpy(rows, key), group.n_agents, f"{source}: {'.'.join(key)}"))
    return np.concatenate(columns, axis=1)


def _ends(
    rows: Any, groups: Sequence[_Group], source: Path, choices: Choices
) -> tuple[Int, Bool, Bool | None]:
    """The order of rows by trajectory, and their flags in that order."""
    terminals = _flags(rows, groups, "terminated", source)
    truncations = _flags(rows, groups, "truncated", source)
    if terminals is None:
        terminals, truncations = _flags(rows, groups, "done", source), None
    if terminals is None:
        raise ConversionError(f"{source} has neither ('next', 'terminated') nor ('next', 'done')")
    if TRAJECTORY_KEY not in leaf_keys(rows):
        return np.arange(len(rows)), terminals, truncations
    ids = _numpy(rows, TRAJECTORY_KEY).reshape(-1)
    order = np.argsort(ids, kind="stable")
    ended = terminals if truncations is None else terminals | truncations
    last = np.append(ids[order][1:] != ids[order][:-1], True)
    open_ends = order[last & ~ended[order].all(axis=1)]
    if len(open_ends) and choices.unfinished is None:
        raise ConversionError(
            f"{source} has {len(open_ends)} trajectories without an end, such as number "
            f"{ids[open_ends[0]]}. Pass unfinished='truncate' to keep them as truncated episodes, "
            "or unfinished='drop' to leave them out."
        )
    if choices.unfinished == "drop":
        order = order[~np.isin(ids[order], ids[open_ends])]
    elif len(open_ends):
        truncations = np.zeros_like(terminals) if truncations is None else truncations.copy()
        truncations[open_ends] = True
    return order, terminals[order], None if truncations is None else truncations[order]


def _reader(
    rows: Any, groups: Sequence[_Group], order: Int
) -> tuple[ReadRows, set[tuple[str, ...]]]:
    """A reader of rows in an order, and the keys that it reads."""
    keys = leaf_keys(rows)
    wanted = {
        "observations": ((), "observation"),
        "next_observations": (("next",), "observation"),
        "actions": ((), "action"),
        "rewards": (("next",), "reward"),
    }
    found: dict[str, list[tuple[tuple[str, ...], _Group]]] = {}
    for ours, (prefix, name) in wanted.items():
        for group in groups:
            own = (*prefix, *group.name, name)
            key = own if own in keys else (*prefix, name)  # the team shares one reward
            found.setdefault(ours, []).append((key, group))
    states = {"states": ("state",), "next_states": ("next", "state")}
    if not keys >= set(states.values()):
        states = {}

    def read(window: slice) -> Arrays:
        index = order[window]
        joint = {ours: rows[key][index].numpy() for ours, key in states.items()}
        for ours, parts in found.items():
            groups = (_by_agent(rows[key][index].numpy(), each.n_agents) for key, each in parts)
            joint[ours] = pad_agents([agent for group in groups for agent in group])
        return joint

    used = {key for parts in found.values() for key, _ in parts}
    return read, used | set(states.values())


def _by_agent(values: NDArray[Any], n_agents: int) -> Sequence[NDArray[Any]]:
    """The rows of each agent of a group, [n, columns]; one reward of a team is that of each."""
    n = len(values)
    columns = values.reshape(n, -1)
    if columns.shape[1] == 1:
        return [columns] * n_agents
    return list(agent_columns(columns, n_agents, "a group").swapaxes(0, 1))
