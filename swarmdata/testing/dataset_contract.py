"""check_dataset, the contract every stored dataset keeps, whoever made it."""

from pathlib import Path
from typing import Any

import numpy as np

from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import SchemaError
from swarmdata.numerics.random import EVALUATION_BASE
from swarmdata.store import SPLITS, EpisodeTable
from swarmdata.store.arrays.running_moments import present_rows
from swarmdata.store.split_rule import assign_splits
from swarmdata.store.table import measure
from swarmdata.types import END_REASONS, Episode


def check_dataset(path: Path | str) -> None:
    """Verifies every byte of a dataset, then that its content is consistent.

    Raises:
        DatasetError: a file cannot be used.
        SchemaError: the first broken promise, with the episode it is in.
    """
    dataset = Dataset.open(path, verify="full")
    check_table(dataset)
    for index, episode in enumerate(dataset):
        check_episode(episode, dataset.episodes, index)
    check_statistics(dataset)
    check_transitions(dataset)


def check_table(dataset: Dataset) -> None:
    """Checks seeds, stream order and splits."""
    table = dataset.episodes
    _require(len(np.unique(table.seeds)) == len(table), "episode seeds repeat")
    _require(bool((table.seeds < EVALUATION_BASE).all()), "an evaluation seed is in the data")
    order = list(zip(table.policy.tolist(), table.policy_episode.tolist(), strict=True))
    for policy in set(table.policy.tolist()):
        stream = table.policy_episode[table.policy == policy]
        _require(bool((np.diff(stream) > 0).all()), f"episodes of policy {policy} are not in order")
    if dataset.recipe.split_rule is not None:
        expected = assign_splits(dataset.recipe, order)
        _require(np.array_equal(table.split, expected), "splits are not those of the rule")
    views = [dataset.filter(split=name).selection for name in SPLITS]
    is_partition = np.array_equal(np.sort(np.concatenate(views)), dataset.selection)
    _require(is_partition, "splits do not partition the episodes")


def check_episode(episode: Episode, table: EpisodeTable, index: int) -> None:
    """Checks flags, values and the row of one episode."""
    where = f"episode {index}: "
    ended = episode.terminations | episode.truncations
    _require(bool(ended[-1]) and not ended[:-1].any(), where + "does not end once, at its end")
    _require(not (episode.terminations & episode.truncations).any(), where + "ended in two ways")
    is_horizon = END_REASONS[episode.end_reason] == "horizon"
    _require(bool(episode.truncations[-1]) == is_horizon, where + "end reason and flags differ")
    for name in ("observations", "states", "actions", "log_probs", "rewards", "layout"):
        _require(bool(np.isfinite(getattr(episode, name)).all()), f"{where}{name} is not finite")
    _require(bool((np.abs(episode.actions) <= 1).all()), where + "actions leave [-1, 1]")
    row: tuple[Any, ...] = (
        int(table.lengths[index]),
        int(table.seeds[index]),
        int(table.policy[index]),
        int(table.end_reason[index]),
        float(table.team_return[index]),
        int(table.robot_collisions[index]),
        int(table.obstacle_collisions[index]),
    )
    _require(row == measure(episode), f"{where}table says {row}, arrays say {measure(episode)}")


def check_statistics(dataset: Dataset) -> None:
    """Checks the moments against the train split, to 1e-6, and what normalizes by them."""
    episodes = list(dataset.split("train"))
    observations = np.concatenate([present_rows(e.observations, e.alive) for e in episodes])
    rewards = np.concatenate([present_rows(e.rewards, e.alive) for e in episodes])
    found, usable = dataset.moments, dataset.statistics
    pairs = (
        ("observation_mean", found.observation_mean, observations.mean(0, dtype=np.float64)),
        ("observation_std", found.observation_std, observations.std(0, dtype=np.float64)),
        ("reward_mean", found.reward_mean, rewards.mean(dtype=np.float64)),
        ("reward_std", found.reward_std, rewards.std(dtype=np.float64)),
    )
    for name, got, expected in pairs:
        is_close = bool(np.allclose(got, expected, rtol=1e-6, atol=1e-8))
        _require(is_close, f"{name} is {got}, expected {expected} from the train split")
    deviations = usable.observation_std
    _require(deviations.dtype == np.float32, f"observation_std has dtype {deviations.dtype}")
    _require(bool((deviations > 0).all()), "statistics have a deviation of 0")
    constant = usable.is_constant
    _require(bool((deviations[constant] == 1).all()), "a constant feature's deviation is not 1")


def check_transitions(dataset: Dataset) -> None:
    """Checks that transitions pair each observation with its successor in the same episode."""
    transitions = dataset.transitions()
    _require(len(transitions["actions"]) == dataset.n_steps, "transitions are missing")
    first = 0
    for index, episode in enumerate(dataset):
        rows = slice(first, first + len(episode))
        for name in ("observations", "states"):
            whole = getattr(episode, name)
            _require(
                np.array_equal(transitions[name][rows], whole[:-1])
                and np.array_equal(transitions[f"next_{name}"][rows], whole[1:]),
                f"episode {index}: transitions do not pair {name} with their successors",
            )
        first += len(episode)


def _require(holds: bool, problem: str) -> None:
    if not holds:
        raise SchemaError(f"dataset contract broken: {problem}")
