"""Measures how much of its task a dataset covers, from samples of fixed size."""

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from swarmdata.analysis.entropy import (
    NEIGHBOR_RANK,
    correlation,
    dither,
    knn_entropy,
    mutual_information,
)
from swarmdata.analysis.passings import Passings, passings
from swarmdata.analysis.visits import Occupancy, occupancy
from swarmdata.numerics.random import derive, uniform
from swarmdata.runtime.mapped_pages import MappedReads, take_rows
from swarmdata.specs.origins import task_of
from swarmdata.specs.state_layout import VX, VY, X, Y, robots_of
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.store import EpisodeTable, StoredDataset
from swarmdata.types import Double, Int

N_ROWS, N_TEAM_ROWS = 5_000, 2_500  # joint steps for entropies of one robot, and of the team

N_PAIR_ROWS, N_PAIRS = 2_000, 12  # most joint steps, and pairs of robots, for mutual information

N_VISITS = 100_000  # states, of whole episodes, in which robots' places are counted

N_ENCOUNTERS = 200  # most episodes of each policy in which passings are counted

ENTROPY_RESOLUTION = 0.01  # width of the noise on repeated values: m, m/s or a share of a command

SAMPLING_SEED = 0  # seed of the samples and of the noise

MIN_STEPS = NEIGHBOR_RANK + 2  # fewest joint steps that the estimators accept

_COMMAND_BOUNDS = (-1.0 - ENTROPY_RESOLUTION / 2, 1.0 + ENTROPY_RESOLUTION / 2)  # noise included

_N_DRIVING = 2  # commands of a robot; what follows in an action is a learned message


@dataclass(frozen=True, slots=True)
class Entropies:
    """Differential entropies at `ENTROPY_RESOLUTION`, nats."""

    robot: float  # of one robot
    team: float  # of all robots jointly, divided by their number; biased upwards, but comparable


@dataclass(frozen=True, slots=True)
class Dependence:
    """How much two robots' commands reveal about each other; means over pairs."""

    n_pairs: int
    information: float  # mutual, nats
    correlation: float  # absolute Pearson correlation of like components


@dataclass(frozen=True, slots=True, eq=False)
class Coverage:
    """Coverage statistics of a dataset or view."""

    n_steps: int  # joint steps from which entropies are estimated
    places: Occupancy  # visits of robots to the cells of the arena
    n_states: int  # states in which visits are counted
    states: Entropies | None  # of positions (m) and velocities (m/s); None: below `MIN_STEPS`
    actions: Entropies | None  # of driving commands, in [-1, 1]; None: below `MIN_STEPS`
    bounds: float  # share of the commands' components that are at a bound
    distinct: float  # share of distinct joint states and actions (Joint SACo, arXiv 2409.12001)
    dependence: Dependence | None  # of robots' commands; None: one robot, or below `MIN_STEPS`
    passings: dict[int, Passings]  # by index of the policy, in the sampled episodes of each


def coverage(stored: StoredDataset) -> Coverage:
    """Measures how much a dataset of at least one episode covers."""
    spec, table = task_of(stored.recipe, "coverage"), stored.table
    chosen = np.arange(len(table))
    steps, states = sample_steps(table, chosen, N_ROWS)
    moves = robots_of(take_rows(stored.arrays["states"], states), spec.n_agents)[
        ..., [X, Y, VX, VY]
    ]
    commands = take_rows(stored.arrays["actions"], steps)[..., :_N_DRIVING]
    places, n_states = places_of(stored, chosen)
    joint = np.concatenate([a.reshape(len(steps), -1) for a in (moves, commands)], axis=1)
    return Coverage(
        n_steps=len(steps),
        places=places,
        n_states=n_states,
        states=_entropies(moves.astype(np.float64), SAMPLING_SEED),
        actions=_entropies(commands.astype(np.float64), SAMPLING_SEED + 1, _COMMAND_BOUNDS),
        bounds=float((np.abs(commands) >= 1.0).mean()),
        distinct=len(np.unique(joint, axis=0)) / len(steps),
        dependence=dependence(commands.astype(np.float64)),
        passings={
            policy: passings_of(stored, spread(chosen[table.policy == policy], N_ENCOUNTERS), spec)
            for policy in np.unique(table.policy).tolist()
        },
    )


def sample_steps(table: EpisodeTable, selection: Int, n_rows: int) -> tuple[Int, Int]:
    """Draws one joint step from each of `n_rows` equal stretches; returns all if there are fewer.

    Returns:
        Their rows in arrays with T rows, and the rows of the states before them, both [n].
    """
    ends = np.cumsum(table.lengths[selection])
    n = min(n_rows, int(ends[-1]))
    edges = (np.arange(n + 1) * ends[-1]) // n
    drawn = uniform(derive(SAMPLING_SEED, np.arange(n))) * np.diff(edges)
    rows = edges[:-1] + drawn.astype(np.int64)
    index = np.searchsorted(ends, rows, side="right")
    within = rows - (ends - table.lengths[selection])[index]
    steps = table.starts[selection][index] + within
    return steps, steps + selection[index]  # each earlier episode has one state more than steps


def spread(items: Int, n: int) -> Int:
    """Returns at most `n` of the items, evenly spread and in order."""
    if len(items) <= n:
        return items
    return items[(np.arange(n) * len(items)) // n]


def dependence(actions: Double) -> Dependence | None:
    """Measures how much robots' commands, [n, N, A], reveal about each other.

    None for a single robot, or fewer than `MIN_STEPS` joint commands.
    """
    rows = spread(np.arange(len(actions)), N_PAIR_ROWS)
    pairs = np.array(list(combinations(range(actions.shape[1]), 2)), dtype=np.int64)
    if not len(pairs) or len(rows) < MIN_STEPS:
        return None
    pairs = pairs[spread(np.arange(len(pairs)), N_PAIRS)]
    blurred = [
        dither(actions[rows, i], ENTROPY_RESOLUTION, SAMPLING_SEED + 2 + i)
        for i in range(actions.shape[1])
    ]
    shared = [mutual_information(blurred[i], blurred[j]) for i, j in pairs.tolist()]
    linear = [correlation(actions[rows, i], actions[rows, j]) for i, j in pairs.tolist()]
    return Dependence(len(pairs), float(np.mean(shared)), float(np.mean(linear)))


def _entropies(
    values: Double, seed: int, bounds: tuple[float, float] | None = None
) -> Entropies | None:
    """Entropies of joint values [n, N, d]; a single robot's values come from each robot in turn."""
    n, n_agents = values.shape[:2]
    if n < MIN_STEPS:
        return None
    one = values[np.arange(n), np.arange(n) % n_agents]
    joint = values[spread(np.arange(n), N_TEAM_ROWS)].reshape(-1, n_agents * values.shape[2])
    return Entropies(
        robot=knn_entropy(dither(one, ENTROPY_RESOLUTION, seed), bounds=bounds),
        team=knn_entropy(dither(joint, ENTROPY_RESOLUTION, seed), bounds=bounds) / n_agents,
    )


def places_of(stored: StoredDataset, selection: Int) -> tuple[Occupancy, int]:
    """Counts robots' visits in about `N_VISITS` states of whole episodes, and the states."""
    table = stored.table
    n_states = int(table.lengths[selection].sum()) + len(selection)
    taken = spread(selection, max(1, (N_VISITS * len(selection)) // n_states))
    reads = MappedReads([stored.arrays["states"]])
    copies = []
    for episode in taken.tolist():
        rows = stored.rows(episode, "states")
        copies.append(rows.copy())
        reads.add(rows)
    reads.release()
    spec, states = task_of(stored.recipe, "coverage"), np.concatenate(copies)
    return occupancy(states, table.layouts[selection], spec), len(states)


def passings_of(stored: StoredDataset, episodes: Int, spec: TaskSpec) -> Passings:
    """Counts on which side robots pass each other in some stored episodes."""
    reads, found = MappedReads([stored.arrays["states"]]), []
    for episode in episodes.tolist():
        states = stored.rows(episode, "states")
        found.append(passings(states, spec))
        reads.add(states)
    reads.release()
    return Passings(*(sum(counts) for counts in zip(*found, strict=True)))
