"""Checks of bytes, shapes and values, which need no knowledge of the world."""

import numpy as np

from swarmdata.audit.findings import Remarks, problem
from swarmdata.audit.subject import Subject, blocks
from swarmdata.errors import DatasetError
from swarmdata.specs.spaces import DiscreteSpace, limits_of, width
from swarmdata.store import open_store
from swarmdata.store.stored_dataset import shape_contradictions
from swarmdata.types import Bool, Int


def integrity(subject: Subject) -> Remarks:
    """Every byte is as it was written: SHA-256 of every file, and the logical digest."""
    try:
        open_store(subject.path, "full")
    except DatasetError as error:
        yield problem(str(error))


def shapes(subject: Subject) -> Remarks:
    """Every array has the sizes of the spec; dtypes and rows are checked on opening."""
    arrays = {name: array.shape for name, array in subject.arrays.items()}
    for each in shape_contradictions(subject.origin, arrays):
        yield problem(each)


def finite(subject: Subject) -> Remarks:
    """No array holds a NaN or an infinity, such as OG-MARL's padding with -inf (issue 27)."""
    for name, array in subject.arrays.items():
        if array.dtype.kind != "f" or not array.size:
            continue
        bad = [first + np.flatnonzero(~np.isfinite(block).reshape(len(block), -1).all(axis=1))
               for first, block in blocks(array)]  # fmt: skip
        rows = np.concatenate(bad)
        if len(rows):
            yield problem(
                f"{len(rows):,} of {len(array):,} rows of {name} hold NaN or infinities, the first "
                f"is row {rows[0]} ({subject.place(name, int(rows[0]))})"
            )


def padding(subject: Subject) -> Remarks:
    """Columns beyond an agent's own are zero, in observations and actions of mixed teams."""
    arrays, spec = subject.arrays, subject.spec
    spaces_of = {
        "observations": spec.observation_spaces(arrays["observations"].shape[2]),
        "actions": spec.action_spaces,
    }
    for name, spaces in spaces_of.items():
        for index, (agent, space) in enumerate(zip(spec.agent_names, spaces, strict=True)):
            own_width = width(space)
            if own_width == arrays[name].shape[2]:
                continue
            for first, block in blocks(arrays[name][:, index, own_width:]):
                wrong = np.flatnonzero(block.any(axis=1))
                if len(wrong):
                    place = subject.place(name, first + int(wrong[0]))
                    yield problem(
                        f"{name} of {agent} have values in the padding, from column {own_width} "
                        f"on, first in {place}; expected zeros"
                    )
                    break


def _acting(subject: Subject, first: int, n_steps: int) -> Bool:
    """Agents that act in consecutive steps, [n, N]; the others have zeros, whatever their space."""
    if "alive" not in subject.arrays:
        return np.ones((n_steps, 1), np.bool_)
    steps = np.arange(first, first + n_steps)
    episodes = np.searchsorted(subject.table.starts, steps, side="right") - 1
    acting: Bool = subject.arrays["alive"][steps + episodes]
    return acting


def action_bounds(subject: Subject) -> Remarks:
    """Actions lie in their space: in [-1, 1] for our tasks; whole numbers where they are choices.

    Those of OMIGA's datasets in OG-MARL exceed [-1, 1], and are clipped on reading.
    """
    limits, actions = limits_of(subject.spec.action_spaces), subject.arrays["actions"]
    for first, block in blocks(actions):
        wrong = limits.outside(block)
        wrong &= _acting(subject, first, len(block))[..., None] | (block != 0)
        if wrong.any():
            row, agent, column = np.argwhere(wrong)[0].tolist()
            yield problem(
                f"action {block[row, agent, column]:g} of agent {agent}, component {column}, in "
                f"{subject.place('actions', first + row)} is not in its space, expected "
                f"{limits.described(agent, column)}"
            )
            return


def action_masks(subject: Subject) -> Remarks:
    """Choices are among the allowed ones, where masks were recorded."""
    if "action_masks" not in subject.arrays:
        return
    spaces = zip(subject.spec.agent_names, subject.spec.action_spaces, strict=True)
    for index, (agent, space) in enumerate(spaces):
        if not isinstance(space, DiscreteSpace):
            continue
        found = [_forbidden(subject, episodes, index, space.start)
                 for episodes in subject.episode_groups()]  # fmt: skip
        wrong = np.concatenate(found)
        if len(wrong):
            yield problem(
                f"{agent} chose what its mask forbids in {len(wrong):,} steps, first in "
                f"{subject.place('actions', int(wrong[0]))}"
            )


def _forbidden(subject: Subject, episodes: slice, agent: int, first_choice: int) -> Int:
    """The steps of consecutive episodes in which an agent made a choice that its mask forbids."""
    masks = subject.rows_of("action_masks", episodes)[:, agent]
    masks = np.delete(masks, np.cumsum(subject.table.lengths[episodes] + 1) - 1, axis=0)
    actions = subject.rows_of("actions", episodes)[:, agent, 0]
    choices = actions.astype(np.int64) - first_choice
    known = masks.any(axis=1) & (choices >= 0) & (choices < masks.shape[1])
    steps = np.flatnonzero(known)
    wrong: Int = steps[~masks[steps, choices[steps]]] + subject.table.starts[episodes][0]
    return wrong
