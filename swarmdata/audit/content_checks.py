"""Checks of the content of rows: copies, frozen rows, crossed ends, jumps, absent agents."""

from typing import Any

import numpy as np
import xxhash
from numpy.typing import NDArray

from swarmdata.audit.episode_checks import repeated
from swarmdata.audit.findings import Remarks, note, problem
from swarmdata.audit.subject import BLOCK_ROWS, Subject, blocks, some
from swarmdata.numerics.weighted_terms import weighted_rewards
from swarmdata.registry.components import make_task, reward_terms
from swarmdata.runtime.mapped_pages import MappedReads, release_pages
from swarmdata.specs.state_layout import X, Y, robots_of
from swarmdata.types import EVENTS, Bool, Float, Int, Seeds

MIN_MOVING_STEPS = 4  # shorter episodes may end before anything has changed
FOREIGN_FAULT_SHARE = 0.5  # of episodes of another library, from which a coincidence is a fault
MIN_DISTINCT_SHARE = 0.5  # of rows in our tasks; published datasets have more than 0.99
MIN_FOREIGN_DISTINCT_SHARE = 0.01  # of rows in other environments, which may be grids
END_EPISODES = 64  # whose ends are compared together: each end may make a huge page resident
MOST_KEYS = 1 << 24  # hashes of rows that are held at a time, 128 MiB
MAX_SPEED_FACTOR = 1.1  # of the fastest robot: a pushed robot may be faster than it can drive
MAX_PUSH_DISTANCE = 0.02  # m that contacts may add in a step: the solver separates bodies


def duplicates(subject: Subject) -> Remarks:
    """No two episodes have the same content, as each has in CFCQL's SMAC datasets of OG-MARL."""
    names = ("observations", "states", "actions")
    keys = np.empty(len(subject.table), dtype=np.uint64)
    reads = MappedReads(subject.arrays[name] for name in names)
    for episode in range(len(subject.table)):
        running = xxhash.xxh3_64()
        for name in names:
            rows = subject.stored.rows(episode, name)
            running.update(np.ascontiguousarray(rows).reshape(-1).view(np.uint8).data)
            reads.add(rows)
        keys[episode] = running.intdigest()
    reads.release()
    yield from repeated(subject, keys, "content")


def row_keys(rows: NDArray[Any]) -> Seeds:
    """A 64-bit hash of the bytes of each row, [n]."""
    data = np.ascontiguousarray(rows).reshape(-1).view(np.uint8).data
    size = len(data) // len(rows)
    starts = range(0, len(data), size)
    found = [xxhash.xxh3_64_intdigest(data[start : start + size]) for start in starts]
    return np.array(found, dtype=np.uint64)


def rows(subject: Subject) -> Remarks:
    """Observations and states change while agents act, and rows are distinct.

    A recorder that does not copy what the environment overwrites breaks it (D4RL issues 84, 100).
    """
    acted = _changes(subject, "actions") > 0
    acted &= subject.table.lengths >= MIN_MOVING_STEPS
    if not acted.any():
        return  # every team stands still
    is_ours = subject.task is not None
    for name in ("observations", "states"):
        if not subject.arrays[name].size:
            continue
        frozen = np.flatnonzero(acted & (_changes(subject, name) <= 1))
        if len(frozen) > (0 if is_ours else FOREIGN_FAULT_SHARE * acted.sum()):
            yield problem(
                f"{name} do not change in episodes {some(frozen)}, although their actions do: "
                "arrays that the environment overwrites must be copied"
            )
        share = _distinct_share(subject, name, acted)
        words = f"only {share:.2%} of the rows of {name} are distinct"
        if is_ours and share < MIN_DISTINCT_SHARE:
            yield problem(f"{words}, expected at least {MIN_DISTINCT_SHARE:.0%}")
        elif not is_ours and share < MIN_FOREIGN_DISTINCT_SHARE:
            yield note(f"{words}; this is right only for an environment with few states")


def _changes(subject: Subject, name: str) -> Int:
    """How often the bits of a row differ from those before it in the same episode, [n]."""
    counts = np.empty(len(subject.table), dtype=np.int64)
    for episodes in subject.episode_groups():
        rows = subject.rows_of(name, episodes)
        bits = rows.reshape(len(rows), -1).view(f"u{rows.dtype.itemsize}")
        starts = subject.starts_of(name)[episodes] - subject.starts_of(name)[episodes.start]
        changed = np.zeros(len(rows), dtype=np.int64)
        changed[1:] = (bits[1:] != bits[:-1]).any(axis=1)
        changed[starts] = 0
        counts[episodes] = np.add.reduceat(changed, starts)
    return counts


def _distinct_share(subject: Subject, name: str, chosen: Bool) -> float:
    """Share of the rows of chosen episodes that are distinct, told apart by a hash."""
    n_rows = int((subject.table.lengths[chosen] + 1).sum())
    # of too many rows, those with small hashes are counted: all copies of a row or none
    greatest = min((1 << 64) - 1, (MOST_KEYS << 64) // n_rows)
    keys = []
    for episodes in subject.episode_groups():
        own = row_keys(subject.rows_of(name, episodes))
        own = own[np.repeat(chosen[episodes], subject.table.lengths[episodes] + 1)]
        keys.append(own[own <= np.uint64(greatest)])
    every = np.concatenate(keys)
    every.sort()
    return (1 + int((every[1:] != every[:-1]).sum())) / len(every)


def boundaries(subject: Subject) -> Remarks:
    """The last row of an episode is the result of its last action.

    It is neither the first row of the next episode, as where environments reset automatically (D4RL
    issues 145, 204), nor a copy of the row before it (d3rlpy issue 164).
    """
    for name in ("observations", "states"):
        if not subject.arrays[name].size:
            continue
        is_copy, is_next_first, first_keys = _ends(subject, name)
        next_first = np.flatnonzero(is_next_first)
        most = 0 if subject.task is not None else FOREIGN_FAULT_SHARE * (len(subject.table) - 1)
        if len(np.unique(first_keys)) > 1 and len(next_first) > most:
            yield problem(
                f"the last row of {name} is the first of the next episode in episodes "
                f"{some(next_first)}: transitions cross episodes"
            )
        long = subject.table.lengths >= MIN_MOVING_STEPS
        copied = long & is_copy
        if copied.sum() > FOREIGN_FAULT_SHARE * max(long.sum(), 1):
            yield problem(
                f"the last row of {name} is a copy of the one before it in episodes "
                f"{some(np.flatnonzero(copied))}: the result of the last action is missing"
            )


def _ends(subject: Subject, name: str) -> tuple[Bool, Bool, Seeds]:
    """Whether last rows are copies, and the next first rows; and keys of first rows, [n] each."""
    array, n = subject.arrays[name], len(subject.table)
    is_copy = np.zeros(n, np.bool_)  # of the row before, which differs from the one before that
    is_next_first = np.zeros(n, np.bool_)  # False for the last episode
    first_keys = np.zeros(n, np.uint64)
    for start in range(0, n, END_EPISODES):
        block = slice(start, start + END_EPISODES)
        last = subject.final_states[block]
        final, before = array[last], array[last - 1]
        is_copy[block] = _same(final, before) & ~_same(array[np.maximum(last - 2, 0)], before)
        first = array[subject.state_starts[start : start + END_EPISODES + 1]]
        first_keys[block] = row_keys(first[: len(last)])
        n_next = len(first[1:])
        is_next_first[start : start + n_next] = _same(final[:n_next], first[1:])
        release_pages(array)
    return is_copy, is_next_first, first_keys


def _same(one: Float, other: Float) -> Bool:
    same: Bool = (one == other).all(axis=tuple(range(1, one.ndim)))
    return same


def teleports(subject: Subject) -> Remarks:
    """No robot moves farther in a step than it can, as the ants of D4RL do (issues 77, 128)."""
    task = subject.task
    if task is None:
        yield note("positions in states of other environments are unknown: jumps were not checked")
        return
    reach = max(task.largest("max_speed")) * task.control_dt  # a slow robot may be pushed by it
    limit = reach * MAX_SPEED_FACTOR + MAX_PUSH_DISTANCE
    states, final = subject.arrays["states"], subject.final_states
    for first in range(0, len(states) - 1, BLOCK_ROWS):
        places = robots_of(states[first : first + BLOCK_ROWS + 1], task.n_agents)[..., [X, Y]]
        moved = np.sqrt((np.diff(places.astype(np.float64), axis=0) ** 2).sum(axis=-1))
        inside = final[(final >= first) & (final < first + len(moved))] - first
        moved[inside] = 0.0  # from the end of an episode to the start of the next
        release_pages(states)
        far = np.argwhere(moved > limit)
        if len(far):
            step, robot = far[0].tolist()
            yield problem(
                f"robot {robot} moves {moved[step, robot]:.3f} m in "
                f"{subject.place('states', first + step)}, expected at most {limit:.3f} m"
            )
            return


def leaving(subject: Subject) -> Remarks:
    """Agents leave by an end, and then neither act, nor observe, nor get rewards, nor end again."""
    if "alive" not in subject.arrays:
        return
    reported: set[str] = set()
    starts = subject.table.starts
    for first in range(0, subject.manifest.n_steps, BLOCK_ROWS):
        steps = np.arange(first, min(first + BLOCK_ROWS, subject.manifest.n_steps))
        states = steps + np.searchsorted(starts, steps, side="right") - 1
        for what, wrong in _misplaced(subject, steps, states).items():
            if wrong.any() and what not in reported:
                reported.add(what)
                row, agent = np.argwhere(wrong)[0].tolist()
                place = subject.place("actions", first + row)
                yield problem(f"there are {what}, first agent {agent} in {place}")
        subject.release()


def _misplaced(subject: Subject, steps: Int, states: Int) -> dict[str, Bool]:
    """Rows that must not exist, by description, [n, N] each: of steps, and the states before."""
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
        found["agents that leave without an end"] = alive & ~later & ~(terminated | cut)
    return found


def rewards(subject: Subject) -> Remarks:
    """Rewards are the stored terms times the weights of the spec, bit for bit (D4RL issue 199)."""
    task, arrays = subject.task, subject.arrays
    if task is None:
        return
    if "reward_terms" not in arrays:
        yield note("the terms of the rewards were not recorded, so rewards have no other weights")
        return
    terms = reward_terms(make_task(task))
    weights = np.array([term.signed_weight for term in terms])
    for first, block in blocks(arrays["reward_terms"]):
        expected = weighted_rewards(block, weights, task.rules.rewards.team_share, task.side_bounds)
        stored = arrays["rewards"][first : first + len(block)].copy()
        release_pages(arrays["rewards"])
        wrong = np.argwhere(stored != expected)
        if len(wrong):
            row, agent = wrong[0].tolist()
            yield problem(
                f"the reward of agent {agent} in {subject.place('rewards', first + row)} is "
                f"{stored[row, agent]}, its terms times the weights of the spec are "
                f"{expected[row, agent]}"
            )
            break
    if arrays["events"].shape[2]:
        yield from _contacts(subject, [term.name for term in terms])


def _contacts(subject: Subject, names: list[str]) -> Remarks:
    """The terms of contacts are the events."""
    arrays, column = subject.arrays, names.index("robot_contact")
    for first, block in blocks(arrays["events"]):
        counted = arrays["reward_terms"][first : first + len(block), :, column:].copy()
        counted = counted[..., : len(EVENTS)]
        release_pages(arrays["reward_terms"])
        differs = np.argwhere(counted != block)
        if len(differs):
            row, agent, event = differs[0].tolist()
            yield problem(
                f"the term {names[column + event]} of agent {agent} in "
                f"{subject.place('rewards', first + row)} is {counted[row, agent, event]:g}, "
                f"events has {EVENTS[event]} {block[row, agent, event]}"
            )
            return
