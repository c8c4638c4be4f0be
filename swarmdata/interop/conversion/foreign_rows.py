"""The gate for rows of others, as they are stored: they become our arrays here, or are refused."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmdata.errors import ConversionError
from swarmdata.interop.conversion.dataset_facts import NEXT_PREFIX, STATE_ARRAYS, Arrays
from swarmdata.interop.conversion.foreign_file import reading
from swarmdata.interop.conversion.imported_data import AgentShapes
from swarmdata.interop.conversion.user_choices import Choices
from swarmdata.specs.spaces import LARGEST_EXACT_INTEGER, to_float32
from swarmdata.store.arrays.layout import ALL_FIELDS
from swarmdata.types import Bool


def admit_rows(rows: Arrays, n_agents: int, where: str) -> dict[str, NDArray[Any]]:
    """Returns rows of others, by our names, [n, ...], as our arrays of N agents.

    States come also after each step (`NEXT_PREFIX`); observations and actions are of one agent
    after the other, with or without an axis for the agents; rewards are of the team or of each.

    Raises:
        SchemaError: float32 does not hold a number, or it is none.
        ConversionError: the sizes do not fit together.
    """
    found: dict[str, NDArray[Any]] = {}
    for name, values in rows.items():
        label, field = f"{where}: {name}", name.removeprefix(NEXT_PREFIX)
        if field == "action_masks":
            found[name] = _bits(values, label)
        elif field == "rewards":
            found[name] = _of_each_agent(to_float32(values, label), n_agents, label)
        else:
            groups = 1 if field == "states" else n_agents
            found[name] = agent_columns(to_float32(values, label), groups, label)
            if field == "states":
                found[name] = found[name][:, 0]
    for name, values in found.items():
        after = found.get(NEXT_PREFIX + name, values)
        if after.shape != values.shape:
            raise ConversionError(
                f"{where}: {NEXT_PREFIX}{name} has rows of shape {after.shape[1:]}, those of "
                f"{name} have {values.shape[1:]}"
            )
    return found


def admit_exported(rows: Arrays, n_rows: int, where: str) -> None:
    """Raises ConversionError unless rows of an export still have the dtypes of our arrays."""
    needed = {"observations", "actions", "rewards", "terminations", "truncations"}
    needed |= {NEXT_PREFIX + name for name in STATE_ARRAYS if name in rows}
    wrong = [f"no {name}" for name in sorted(needed - set(rows))]
    for name, values in rows.items():
        dtypes = ALL_FIELDS[name.removeprefix(NEXT_PREFIX)].dtypes
        if str(values.dtype) not in dtypes or len(values) != n_rows:
            wrong.append(f"{name} of type {values.dtype} with {len(values)} rows")
    if wrong:
        raise ConversionError(
            f"{where} has {', '.join(wrong)}, expected {n_rows} rows as they were exported. It was "
            "changed since: without the note of swarmdata it is converted as foreign data."
        )


def flags_of(values: Any, n_agents: int, where: str) -> Bool:
    """Flags of each agent in each row, [n, N], of 0 and 1; a team's flag is that of each agent."""
    return _of_each_agent(_bits(values, where), n_agents, where)


def _bits(values: Any, where: str) -> Bool:
    bits = to_float32(values, where)
    wrong = (bits != 0) & (bits != 1)
    if wrong.any():
        raise ConversionError(f"{where} has the value {bits[wrong][0]:g}, expected flags: 0 or 1")
    return np.asarray(bits != 0)


def _of_each_agent(values: NDArray[Any], n_agents: int, where: str) -> NDArray[Any]:
    """Repeats a team's column for every agent, [n, N]."""
    columns = values.reshape(len(values), columns_of(values.shape))
    if columns.shape[1] not in (1, n_agents):
        raise ConversionError(
            f"{where} has rows of shape {values.shape[1:]}, expected one value, or one for each of "
            f"{n_agents} agents"
        )
    return np.broadcast_to(columns, (len(values), n_agents)).copy()


def agent_columns(values: NDArray[Any], n_agents: int, where: str) -> NDArray[Any]:
    """Divides the columns of a team among its agents, [n, N, columns], or refuses them."""
    n_columns = columns_of(values.shape)
    if n_columns % n_agents:
        raise ConversionError(
            f"{where} has rows of shape {values.shape[1:]}, whose {n_columns} numbers cannot be "
            f"divided among {n_agents} agents"
        )
    return values.reshape(len(values), n_agents, n_columns // n_agents)


def columns_of(shape: Sequence[int]) -> int:
    """Numbers in a row of an array of this shape."""
    return int(np.prod(shape[1:], dtype=np.int64))


def count_choices(actions: NDArray[Any], where: str) -> tuple[int, ...]:
    """Counts of choices in each column of whole-number actions, [..., A]; () for other actions."""
    if actions.dtype.kind not in "iu":
        return ()
    if not actions.size:
        raise ConversionError(
            f"{where} has actions of shape {actions.shape}, expected some numbers"
        )
    columns = actions.reshape(-1, actions.shape[-1])
    lows, highs = columns.min(axis=0), columns.max(axis=0)
    if lows.min() < 0 or highs.max() >= LARGEST_EXACT_INTEGER:
        raise ConversionError(
            f"{where} has whole-number actions from {lows.min()} to {highs.max()}, expected "
            f"choices, counted from 0 and below {LARGEST_EXACT_INTEGER}. Store continuous actions "
            "as float32."
        )
    return tuple((highs.astype(np.int64) + 1).tolist())


def share_choices(counts: Sequence[tuple[int, ...]]) -> tuple[tuple[int, ...], ...]:
    """Gives agents with as many columns the same choices: the greatest count of each column."""
    most: dict[int, tuple[int, ...]] = {}
    for each in counts:
        most[len(each)] = tuple(map(max, each, most.get(len(each), each)))
    return tuple(most[len(each)] for each in counts)


def pad_agents(values: Sequence[NDArray[Any]]) -> NDArray[Any]:
    """Rows of all agents, [n, N, most columns], in a dtype that holds them all; padding is zero."""
    most = max(each.shape[1] for each in values)
    joint = np.zeros((len(values[0]), len(values), most), np.result_type(*values))
    for k, each in enumerate(values):
        joint[:, k, : each.shape[1]] = each
    return joint


def check_lengths(counts: Mapping[str, int], source: str) -> int:
    """The number of rows that all arrays have; ConversionError if there are none or they differ."""
    if len(set(counts.values())) != 1:
        raise ConversionError(f"{source} has arrays of different lengths: {dict(counts)}")
    n_rows = next(iter(counts.values()))
    if not n_rows:
        raise ConversionError(f"{source} has no rows, expected at least 1")
    return n_rows


def team_shapes(
    observations: Sequence[int], actions: Any, choices: Choices, source: str, n_states: int = 0
) -> AgentShapes:
    """Sizes of a team of equal agents, by the agent axis of observations, else by the user.

    These have the shape [n, O], [n, N * O] or [n, N, O]; actions, an array or file [n, ...], are
    all read if they are whole numbers.
    """
    if len(observations) > 3:
        raise ConversionError(
            f"{source} has observations of shape {tuple(observations)}, expected [n, O], "
            "[n, N * O] or [n, N, O]"
        )
    n_agents = int(observations[1]) if len(observations) > 2 else choices.team_size or 1
    if choices.team_size not in (None, n_agents) or not n_agents:
        raise ConversionError(
            f"{source} has observations of shape {tuple(observations)}, which does not fit "
            f"{choices.team_size or n_agents} agents"
        )
    sizes = {"observations": columns_of(observations), "actions": columns_of(actions.shape)}
    if wrong := {name: size for name, size in sizes.items() if size % n_agents}:
        raise ConversionError(
            f"{source} has rows of sizes {wrong}, which cannot be divided among {n_agents} agents"
        )
    counts: tuple[int, ...] = ()
    if actions.dtype.kind in "iu":
        with reading(source):
            values = actions[:]
        counts = count_choices(agent_columns(values, n_agents, source), source)
    return AgentShapes(
        observations=(sizes["observations"] // n_agents,) * n_agents,
        actions=(sizes["actions"] // n_agents,) * n_agents,
        choices=(counts,) * n_agents,
        states=n_states,
    )
