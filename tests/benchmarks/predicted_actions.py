"""How well cloned policies predict the commands of logs that they were not trained on.

    swarmdata train bc mrclam-run_6-v1 --seeds 2 --out runs/bc-6
    python -m tests.benchmarks.predicted_actions mrclam-run_7-v1 runs/bc-6 runs/gru-6
    python -m tests.benchmarks.predicted_actions mrclam-run_7-v1 runs/bc-6-no-1,runs/bc-6-no-2

A policy's action for a step is compared with the command that was logged in it, and with the one
two seconds later; so are the command of the step before and the mean one. Logs that a task has
scored are compared in the same units. It takes every fifth episode, because exported policies act
robot by robot. Runs of a dataset that leaves out robots predict these robots only, and several such
runs, separated by commas, are one row. The first run is subtracted from the others. `make bench`
leaves it out: users fetch the logs.
"""

import runpy
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import swarmdata
from swarmdata.datasets.action_scaling import action_scale
from swarmdata.learn.policies.sequence_policy import SequencePolicy
from swarmdata.learn.training.run_files import seeds_of
from swarmdata.learn.training.run_folder import load_run
from swarmdata.rollouts.score_intervals import (
    AT_LEAST_ZERO,
    difference_interval,
    mean_interval,
)
from swarmdata.rollouts.score_statistics import Estimate
from swarmdata.types import blank_step

AHEAD = 20  # steps of 0.1 s

STRIDE = 5  # every so many episodes


def predicted(
    policy: Any, episodes: Sequence[swarmdata.Episode], numbers: Mapping[int, int]
) -> Iterator[np.ndarray]:
    """Commands of an exported policy in each episode, [T, N, A], in the units of the logs.

    Args:
        policy: of the exported file.
        episodes: of the logs.
        numbers: robot of the logs -> robot of the policy as which it acts; NaN for the others.
    """
    for episode in episodes:
        commands = np.full_like(episode.actions, np.nan)
        for n, number in numbers.items():
            middle, half = (
                np.array(policy.about["commands"][number][k]) for k in ("middle", "half")
            )
            memory: Any = np.zeros(policy.about["memory"])
            for t, observation in enumerate(episode.observations[:-1, n]):
                action, memory = policy.step(observation, number, memory)
                commands[t, n] = middle + half * np.clip(action, -1, 1)
        yield commands


def errors_of(
    policy: Any, names: Sequence[str], episodes: Sequence[swarmdata.Episode], units: np.ndarray
) -> np.ndarray:
    """Errors of an exported policy for the robots that it was not trained on, [E, N, 4].

    Such a robot acts as each of the policy's robots in turn, and its errors are their means. A
    policy that was trained on all robots predicts all of them, each as itself.
    """
    known = policy.about["robots"]
    new = [n for n, name in enumerate(names) if name not in known]
    if not new:
        numbers = {n: known.index(name) for n, name in enumerate(names)}
        return errors(episodes, predicted(policy, episodes, numbers), units)
    turns = (dict.fromkeys(new, number) for number in range(len(known)))
    return np.mean(
        [errors(episodes, predicted(policy, episodes, each), units) for each in turns], axis=0
    )


def decided_in_order(
    policy: swarmdata.Policy, dataset: swarmdata.Dataset, episodes: Sequence[swarmdata.Episode]
) -> Iterator[np.ndarray]:
    """As `predicted`, of a policy that acts for the team and is not exported robot by robot."""
    scale = action_scale(dataset.spec)
    for episode in episodes:
        commands = np.zeros_like(episode.actions)
        for t in range(len(commands)):
            step = blank_step(episode.observations[t][None], episode.states[t][None])
            if t == 0:
                policy.reset(step, np.arange(1))
            commands[t] = scale.middle + scale.half * policy.act(step)[0]
        yield commands


def errors(
    episodes: Sequence[swarmdata.Episode], guesses: Iterator[np.ndarray], units: np.ndarray
) -> np.ndarray:
    """Mean absolute errors of speed and turn rate, at once and later, [E, N, 4].

    They are NaN for robots that were absent.
    """
    rows = []
    for episode, guess in zip(episodes, guesses, strict=True):
        alive = np.ones(guess.shape[:2], np.bool_)
        if episode.alive is not None:
            alive = episode.alive[:-1]
        last = len(guess) - AHEAD
        known = alive[: last - 1] & alive[1:last] & alive[1 + AHEAD :]
        logged = units * episode.actions
        now, later = logged[1:last], logged[1 + AHEAD :]
        wrong = np.concatenate([np.abs(guess[1:last] - each) for each in (now, later)], axis=2)
        total = (wrong * known[..., None]).sum(axis=0)
        with np.errstate(invalid="ignore"):
            rows.append(total / known.sum(axis=0)[:, None])
    return np.array(rows)


def repeated(episodes: Sequence[swarmdata.Episode], units: np.ndarray) -> Iterator[np.ndarray]:
    """The command of the step before."""
    for episode in episodes:
        yield units * np.concatenate([episode.actions[:1], episode.actions[:-1]])


def constant(
    episodes: Sequence[swarmdata.Episode], units: np.ndarray, *, of_others: bool = False
) -> Iterator[np.ndarray]:
    """The mean command of every robot, or that of all others, of these episodes themselves."""
    mean = units * np.concatenate([each.actions for each in episodes]).mean(axis=0)
    if of_others:
        mean = (mean.sum(axis=0) - mean) / (len(mean) - 1)
    for episode in episodes:
        yield np.broadcast_to(mean, episode.actions.shape)


def units_of(dataset: swarmdata.Dataset) -> np.ndarray:
    """An action of 1 in m/s and rad/s, of every robot, [N, 2]."""
    task = dataset.spec.world
    if task is None:
        return np.ones((dataset.spec.n_agents, 2))
    return np.array([[each.max_speed, each.max_turn_rate] for each in task.robots])


def run_errors(
    run: str, dataset: swarmdata.Dataset, episodes: Sequence[swarmdata.Episode], units: np.ndarray
) -> np.ndarray:
    """Errors of the policies of a run, [K seeds, E, N, 4]."""
    found = []
    for policy, seed in zip(load_run(run), seeds_of([Path(run)]), strict=True):
        if isinstance(policy, SequencePolicy):
            guesses = decided_in_order(policy, dataset, episodes)
            found.append(errors(episodes, guesses, units))
            continue
        with tempfile.TemporaryDirectory() as folder:
            path = swarmdata.export_policy(run, Path(folder) / "policy.py", seed.seed)
            exported = runpy.run_path(str(path))["Policy"]()
        found.append(errors_of(exported, dataset.spec.agent_names, episodes, units))
    return np.stack(found)


def cell(found: Estimate) -> str:
    return f"{found.value:.2f} [{found.low:.2f}, {found.high:.2f}]"


def columns(table: np.ndarray) -> Iterator[np.ndarray]:
    """Each quantity, [K, E or N], of a table [K, E or N, 4]."""
    yield from np.moveaxis(table, -1, 0)


def main(data: str, *runs: str) -> None:
    """Prints a table with intervals over seeds and episodes, and one over seeds and robots."""
    dataset = swarmdata.load(data)
    units = units_of(dataset)
    episodes = [each for each in list(dataset)[::STRIDE] if len(each) > AHEAD + 2]
    guesses = {
        "last command": repeated(episodes, units),
        "mean command": constant(episodes, units),
        "mean command of the other robots": constant(episodes, units, of_others=True),
    }
    tables = {name: errors(episodes, each, units)[None] for name, each in guesses.items()}
    for row in runs:
        parts = [run_errors(run, dataset, episodes, units) for run in row.split(",")]
        tables[row] = np.fmax.reduce(parts)  # each part has other robots, the rest is NaN
    scales = np.array([100.0, 180 / np.pi] * 2)
    for over, axis in (("episodes", 2), ("robots", 1)):
        print(f"| over {over} | speed (cm/s) | turn rate (°/s) | speed in 2 s | turn rate in 2 s |")
        print("|---|---:|---:|---:|---:|")
        means = {name: scales * np.nanmean(table, axis=axis) for name, table in tables.items()}
        for name, mean in means.items():
            cells = [cell(mean_interval(each, bounds=AT_LEAST_ZERO)) for each in columns(mean)]
            print(f"| {name} | {' | '.join(cells)} |")
        for run in runs[1:]:
            pairs = zip(columns(means[run]), columns(means[runs[0]]), strict=True)
            cells = [cell(difference_interval(*pair)) for pair in pairs]
            print(f"| {run} minus {runs[0]} | {' | '.join(cells)} |")


if __name__ == "__main__":
    main(*sys.argv[1:])
