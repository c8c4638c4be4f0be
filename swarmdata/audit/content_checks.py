"""Checks of what the rows hold: repeated episodes, frozen rows, crossed ends, jumps, the dead."""

import numpy as np
import xxhash
from numpy.typing import NDArray

from swarmdata.audit.episode_checks import repeated
from swarmdata.audit.findings import Remarks, note, problem
from swarmdata.audit.subject import BLOCK_ROWS, Subject, blocks, some
from swarmdata.specs.state_layout import X, Y, robots_of
from swarmdata.types import Bool, Float, Int, Seeds

MIN_MOVING_STEPS = 4
"""Episodes of fewer steps may end before anything has changed."""

FOREIGN_FAULT_SHARE = 0.5
"""Share of episodes of a foreign environment from which a coincidence is a fault."""

MIN_DISTINCT_SHARE = 0.5
"""Share of distinct rows, of our tasks: published datasets have more than 0.99."""

MIN_FOREIGN_DISTINCT_SHARE = 0.01
"""The same of other environments, which may be grids."""

MAX_SPEED_FACTOR = 1.1
"""A robot that is pushed goes faster than it drives."""

MAX_PUSH_DISTANCE = 0.02
"""Distance (m) that contacts may add in one step: overlaps are resolved by moving bodies."""


def duplicates(subject: Subject) -> Remarks:
    """No two episodes have the same content.

    CFCQL's SMAC datasets in OG-MARL hold each episode eight to ten times, train and test alike.
    """
    names = ("observations", "states", "actions")
    keys = np.empty(len(subject.table), dtype=np.uint64)
    for episode, length in enumerate(subject.table.lengths.tolist()):
        running = xxhash.xxh3_64()
        for name in names:
            first = int(subject.starts_of(name)[episode])
            rows = subject.arrays[name][first : first + length + (name != "actions")]
            running.update(np.ascontiguousarray(rows).reshape(-1).view(np.uint8).data)
        keys[episode] = running.intdigest()
    yield from repeated(subject, keys, "content")


def row_keys(array: NDArray[np.float32]) -> Seeds:
    """A 64-bit hash of the bytes of each row, [n]."""
    keys = np.empty(len(array), dtype=np.uint64)
    for first, block in blocks(array):
        data = np.ascontiguousarray(block).reshape(-1).view(np.uint8).data
        size = len(data) // len(block)
        starts = range(0, len(data), size)
        keys[first : first + len(block)] = [
            xxhash.xxh3_64_intdigest(data[start : start + size]) for start in starts
        ]
    return keys


def rows(subject: Subject) -> Remarks:
    """What is seen changes while agents act, and rows are distinct.

    D4RL's v1 positions had two distinct rows, for want of a copy, and v2's were wrong again (D4RL
    issues 84 and 100); OG-MARL's recorder keeps the first state for the whole episode.
    """
    acted = _changes(row_keys(subject.arrays["actions"]), subject.table.starts) > 0
    acted &= subject.table.lengths >= MIN_MOVING_STEPS
    if not acted.any():
        return  # teams that stand still
    starts = subject.state_starts
    whole = np.repeat(acted, subject.table.lengths + 1)
    is_ours = subject.task is not None
    for name in ("observations", "states"):
        if not subject.arrays[name].size:
            continue
        keys = row_keys(subject.arrays[name])
        frozen = np.flatnonzero(acted & (_changes(keys, starts) <= 1))
        if len(frozen) > (0 if is_ours else FOREIGN_FAULT_SHARE * acted.sum()):
            yield problem(
                f"{name} do not change in episodes {some(frozen)}, although their actions do: "
                "arrays that the environment overwrites must be copied"
            )
        share = len(np.unique(keys[whole])) / int(whole.sum())
        words = f"only {share:.2%} of the rows of {name} are distinct"
        if is_ours and share < MIN_DISTINCT_SHARE:
            yield problem(f"{words}, expected at least {MIN_DISTINCT_SHARE:.0%}")
        elif not is_ours and share < MIN_FOREIGN_DISTINCT_SHARE:
            yield note(f"{words}; that is right only of an environment with few states")


def _changes(keys: Seeds, starts: Int) -> Int:
    """How often a row differs from the one before it in the same episode, [n]."""
    changed = np.ones(len(keys), dtype=np.int64)
    changed[1:] = keys[1:] != keys[:-1]
    changed[starts] = 0
    counts: Int = np.add.reduceat(changed, starts)
    return counts


def boundaries(subject: Subject) -> Remarks:
    """The last row of an episode is what its last action led to.

    It is neither the first row of the next episode (D4RL's `qlearning_dataset`, issues 145 and 204;
    vectorized environments that reset themselves) nor a copy of the row before it (d3rlpy issue
    164).
    """
    for name in ("observations", "states"):
        array, last = subject.arrays[name], subject.state_starts + subject.table.lengths
        if not array.size:
            continue
        final = array[last]
        yield from _crossing(subject, name, final, array[subject.state_starts])
        long = subject.table.lengths >= MIN_MOVING_STEPS
        copied = long & _same(final, array[last - 1])
        copied &= ~_same(array[np.maximum(last - 2, 0)], array[last - 1])
        if copied.sum() > FOREIGN_FAULT_SHARE * max(long.sum(), 1):
            yield problem(
                f"the last row of {name} is a copy of the one before it in episodes "
                f"{some(np.flatnonzero(copied))}: what the last action led to is missing"
            )


def _crossing(subject: Subject, name: str, final: Float, first: Float) -> Remarks:
    next_first = np.flatnonzero(_same(final[:-1], first[1:]))
    starts_differ = len(np.unique(row_keys(first))) > 1
    most = 0 if subject.task is not None else FOREIGN_FAULT_SHARE * (len(final) - 1)
    if starts_differ and len(next_first) > most:
        yield problem(
            f"the last row of {name} is the first of the next episode in episodes "
            f"{some(next_first)}: transitions cross episodes"
        )


def _same(one: Float, other: Float) -> Bool:
    """Which rows are equal, [n]."""
    same: Bool = (one == other).reshape(len(one), -1).all(axis=1)
    return same


def teleports(subject: Subject) -> Remarks:
    """No robot moves farther in a step than it can.

    D4RL's antmaze flags are out of step with its episodes, so that ants jump 21 units (D4RL issues
    77 and 128, PR 101).
    """
    task = subject.task
    if task is None:
        yield note("positions in states of other environments are not known: no jumps looked for")
        return
    reach = np.array([robot.max_speed * task.control_dt for robot in task.robots])
    limits = reach * MAX_SPEED_FACTOR + MAX_PUSH_DISTANCE
    states, final = subject.arrays["states"], subject.state_starts + subject.table.lengths
    for first in range(0, len(states) - 1, BLOCK_ROWS):
        places = robots_of(states[first : first + BLOCK_ROWS + 1], task.n_agents)[..., [X, Y]]
        moved = np.sqrt((np.diff(places.astype(np.float64), axis=0) ** 2).sum(axis=-1))
        inside = final[(final >= first) & (final < first + len(moved))] - first
        moved[inside] = 0.0  # from the end of an episode to the start of the next
        far = np.argwhere(moved > limits)
        if len(far):
            step, robot = far[0].tolist()
            yield problem(
                f"robot {robot} moves {moved[step, robot]:.3f} m in "
                f"{subject.place('states', first + step)}, expected at most {limits[robot]:.3f} m"
            )
            return


def leaving(subject: Subject) -> Remarks:
    """Agents that are not in an episode do nothing, get nothing, and do not end again.

    OG-MARL has no mask of who is alive; readers take the zeros of the dead for data.
    """
    if "alive" not in subject.arrays:
        return
    told: set[str] = set()
    starts = subject.table.starts
    for first in range(0, subject.manifest.n_steps, BLOCK_ROWS):
        steps = np.arange(first, min(first + BLOCK_ROWS, subject.manifest.n_steps))
        states = steps + np.searchsorted(starts, steps, side="right") - 1
        for what, wrong in _misplaced(subject, steps, states).items():
            if wrong.any() and what not in told:
                told.add(what)
                row, agent = np.argwhere(wrong)[0].tolist()
                place = subject.place("actions", first + row)
                yield problem(f"there are {what}, first agent {agent} in {place}")


def _misplaced(subject: Subject, steps: Int, states: Int) -> dict[str, Bool]:
    """What must not be, by its words, [n, N] each.

    Args:
        subject: with `alive`.
        steps: rows of actions, [n].
        states: rows of the states before them, [n].
    """
    arrays = subject.arrays
    alive, later = arrays["alive"][states], arrays["alive"][states + 1]
    found = {
        "actions of agents that are gone": ~alive & arrays["actions"][steps].any(axis=2),
        "rewards of agents that are gone": ~alive & (arrays["rewards"][steps] != 0),
        "observations of agents that are gone": ~alive
        & ~later
        & arrays["observations"][states + 1].any(axis=2),
    }
    if "agent_terminations" in arrays and "agent_truncations" in arrays:
        terminated, cut = arrays["agent_terminations"][steps], arrays["agent_truncations"][steps]
        goes_on = ~np.isin(steps, subject.last_steps)[:, None]
        found["agents that are terminated and truncated"] = terminated & cut
        found["ends of agents that are gone"] = (terminated | cut) & ~alive
        found["agents that go on after their end"] = (terminated | cut) & later & goes_on
    return found
