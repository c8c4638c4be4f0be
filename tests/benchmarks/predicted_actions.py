"""How well cloned policies predict the commands of logs that they were not trained on.

    swarmdata train bc mrclam-run_6-v1 --seeds 2 --out runs/bc-6
    python -m tests.benchmarks.predicted_actions mrclam-run_7-v1 runs/bc-6 runs/gru-6

A policy's action for a step is compared with the command that was logged in it, and with the one
two seconds later; so are the command of the step before and the mean one. Logs that a task has
scored are compared in the same units. It takes every fifth episode, because exported policies act
robot by robot. `make bench` leaves it out: users fetch the logs.
"""

import runpy
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import swarmdata
from swarmdata.datasets.action_scaling import action_scale
from swarmdata.learn.policies.sequence_policy import SequencePolicy
from swarmdata.learn.training.run_files import seeds_of
from swarmdata.learn.training.run_folder import load_run
from swarmdata.rollouts.score_intervals import AT_LEAST_ZERO, mean_interval
from swarmdata.types import blank_step

AHEAD = 20  # steps of 0.1 s

STRIDE = 5  # every so many episodes


def predicted(path: Path, episodes: Sequence[swarmdata.Episode]) -> Iterator[np.ndarray]:
    """Commands of an exported policy in each episode, [T, N, A], in the units of the logs."""
    policy = runpy.run_path(str(path))["Policy"]()
    middles, halves = (
        np.array([each[key] for each in policy.about["commands"]]) for key in ("middle", "half")
    )
    for episode in episodes:
        commands = np.zeros_like(episode.actions)
        for n in range(episode.actions.shape[1]):
            memory: Any = np.zeros(policy.about["memory"])
            for t, observation in enumerate(episode.observations[:-1, n]):
                action, memory = policy.step(observation, n, memory)
                commands[t, n] = middles[n] + halves[n] * np.clip(action, -1, 1)
        yield commands


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


def constant(episodes: Sequence[swarmdata.Episode], units: np.ndarray) -> Iterator[np.ndarray]:
    """The mean command of every robot, of these episodes themselves."""
    mean = units * np.concatenate([each.actions for each in episodes]).mean(axis=0)
    for episode in episodes:
        yield np.broadcast_to(mean, episode.actions.shape)


def units_of(dataset: swarmdata.Dataset) -> np.ndarray:
    """An action of 1 in m/s and rad/s, of every robot, [N, 2]."""
    task = dataset.spec.world
    if task is None:
        return np.ones((dataset.spec.n_agents, 2))
    return np.array([[each.max_speed, each.max_turn_rate] for each in task.robots])


def cell(table: np.ndarray, scale: float) -> str:
    found = mean_interval(scale * table, bounds=AT_LEAST_ZERO)
    return f"{found.value:.2f} [{found.low:.2f}, {found.high:.2f}]"


def main(data: str, *runs: str) -> None:
    """Prints a table with intervals over seeds and episodes, and one over seeds and robots."""
    dataset = swarmdata.load(data)
    units = units_of(dataset)
    episodes = [each for each in list(dataset)[::STRIDE] if len(each) > AHEAD + 2]
    tables = {
        "last command": errors(episodes, repeated(episodes, units), units)[None],
        "mean command": errors(episodes, constant(episodes, units), units)[None],
    }
    for run in runs:
        found = []
        for policy, seed in zip(load_run(run), seeds_of([Path(run)]), strict=True):
            if isinstance(policy, SequencePolicy):
                guesses = decided_in_order(policy, dataset, episodes)
                found.append(errors(episodes, guesses, units))
                continue
            with tempfile.TemporaryDirectory() as folder:
                path = swarmdata.export_policy(run, Path(folder) / "policy.py", seed.seed)
                found.append(errors(episodes, predicted(path, episodes), units))
        tables[run] = np.stack(found)
    for over, axis in (("episodes", 2), ("robots", 1)):
        print(f"| over {over} | speed (cm/s) | turn rate (°/s) | speed in 2 s | turn rate in 2 s |")
        print("|---|---:|---:|---:|---:|")
        for name, table in tables.items():
            means = np.nanmean(table, axis=axis)
            cells = [cell(means[..., k], scale) for k, scale in enumerate((100.0, 180 / np.pi) * 2)]
            print(f"| {name} | {' | '.join(cells)} |")


if __name__ == "__main__":
    main(*sys.argv[1:])
