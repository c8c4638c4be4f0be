"""Checks of bytes, shapes and values, for which nothing needs to be known of the world."""

import numpy as np

from swarmdata.audit.findings import Remarks, problem
from swarmdata.audit.subject import Subject, blocks
from swarmdata.errors import DatasetError
from swarmdata.specs.spaces import DiscreteSpace, bounds, width
from swarmdata.store import open_store
from swarmdata.store.stored_dataset import shape_contradictions
from swarmdata.types import Bool, Float, Int


def integrity(subject: Subject) -> Remarks:
    """Every byte is as it was written: SHA-256 of every file, and the logical digest.

    Minari 0.5.4 has no checksum: a flipped byte gives wrong rewards without a word
    (notes on Minari, integrity). OG-MARL takes a half-unzipped vault for a whole one.
    """
    try:
        open_store(subject.path, "full")
    except DatasetError as error:
        yield problem(str(error))


def shapes(subject: Subject) -> Remarks:
    """Every array has the sizes that the spec says; dtypes and rows are checked on opening.

    Minari's and OG-MARL's readers take what is there: OG-MARL stores one halfcheetah's state as
    (T, N, S), the others' as (T, S), and its cards say "discrete" of continuous actions.
    """
    arrays = {name: array.shape for name, array in subject.arrays.items()}
    for each in shape_contradictions(subject.origin, arrays):
        yield problem(each)


def finite(subject: Subject) -> Remarks:
    """No array holds a NaN or an infinity.

    OG-MARL pads OMAR's observations with -inf (og-marl issue 27), which poisons every mean.
    """
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
    """Columns beyond an agent's own are zero, in observations and actions of mixed teams.

    OG-MARL pads with zeros in some datasets and with -inf in others, and says so in none.
    """
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
    """Who acts in consecutive steps, [n, N]; those who do not have zeros, whatever their space."""
    if "alive" not in subject.arrays:
        return np.ones((n_steps, 1), np.bool_)
    steps = np.arange(first, first + n_steps)
    episodes = np.searchsorted(subject.table.starts, steps, side="right") - 1
    acting: Bool = subject.arrays["alive"][steps + episodes]
    return acting


def action_bounds(subject: Subject) -> Remarks:
    """Actions lie in their space: in [-1, 1] for our tasks; whole numbers where they are choices.

    Actions of OMIGA's datasets in OG-MARL exceed [-1, 1], so its code clips them when they are
    read ("clip for omiga datasets"), and the data says otherwise than the environment.
    """
    lows, highs, whole = _limits(subject)
    actions = subject.arrays["actions"]
    for first, block in blocks(actions):
        wrong = (block < lows) | (block > highs) | (whole & (block != np.round(block)))
        wrong &= _acting(subject, first, len(block))[..., None] | (block != 0)
        if wrong.any():
            row, agent, column = np.argwhere(wrong)[0].tolist()
            yield problem(
                f"action {block[row, agent, column]:g} of agent {agent}, component {column}, in "
                f"{subject.place('actions', first + row)} is not in its space, expected "
                f"{'a whole number from' if whole[agent, column] else 'a value from'} "
                f"{lows[agent, column]:g} to {highs[agent, column]:g}"
            )
            return


def _limits(subject: Subject) -> tuple[Float, Float, Bool]:
    """Least and greatest value of each action component, and which are whole, [N, A] each."""
    shape = subject.arrays["actions"].shape[1:]
    lows, highs = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
    whole = np.zeros(shape, dtype=np.bool_)
    for index, space in enumerate(subject.spec.action_spaces):
        low, high = bounds(space)
        lows[index, : len(low)], highs[index, : len(high)] = low, high
        whole[index, : len(low)] = space.kind in ("discrete", "multi_discrete", "multi_binary")
    return lows, highs, whole


def action_masks(subject: Subject) -> Remarks:
    """Choices are among those that were allowed, where that is recorded.

    OG-MARL's recorder keeps the legal actions of the first step for the whole episode
    (`ExperienceRecorder`, a misspelt attribute), so that later choices look illegal.
    """
    if "action_masks" not in subject.arrays:
        return
    rows = np.delete(np.arange(len(subject.arrays["action_masks"])), _final_rows(subject))
    spaces = zip(subject.spec.agent_names, subject.spec.action_spaces, strict=True)
    for index, (agent, space) in enumerate(spaces):
        if not isinstance(space, DiscreteSpace):
            continue
        masks = subject.arrays["action_masks"][rows, index]
        choices = subject.arrays["actions"][:, index, 0].astype(np.int64) - space.start
        known = masks.any(axis=1) & (choices >= 0) & (choices < masks.shape[1])
        steps = np.flatnonzero(known)
        wrong = steps[~masks[steps, choices[steps]]]
        if len(wrong):
            yield problem(
                f"{agent} chose what its mask forbids in {len(wrong):,} steps, first in "
                f"{subject.place('actions', int(wrong[0]))}"
            )


def _final_rows(subject: Subject) -> Int:
    """Rows of the last states, after which nothing is chosen."""
    final: Int = subject.state_starts + subject.table.lengths
    return final
