"""How well cloned policies predict the commands of logs that they were not trained on.

    swarmdata train bc mrclam-run_6-v0 --seeds 2 --out runs/bc-6
    python -m tests.benchmarks.predicted_actions mrclam-run_7-v0 runs/bc-6 runs/gru-6

A policy's action for a step is compared with the command that was logged in it, and with the one
two seconds later; so are the command of the step before and the mean one. It takes every fifth
episode, because exported policies act robot by robot. `make bench` leaves it out: users fetch the
logs.
"""

import runpy
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import swarmdata
from swarmdata.learn.training.run_files import seeds_of
from swarmdata.rollouts.score_intervals import AT_LEAST_ZERO, mean_interval

AHEAD = 20  # steps of 0.1 s


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


def errors(episodes: Sequence[swarmdata.Episode], guesses: Iterator[np.ndarray]) -> np.ndarray:
    """Mean absolute errors of each episode, at once and later, of speed and turn rate, [E, 4]."""
    rows = []
    for episode, guess in zip(episodes, guesses, strict=True):
        alive = np.ones(guess.shape[:2], np.bool_)
        if episode.alive is not None:
            alive = episode.alive[:-1]
        last = len(guess) - AHEAD
        known = alive[: last - 1] & alive[1:last] & alive[1 + AHEAD :]
        now, later = episode.actions[1:last], episode.actions[1 + AHEAD :]
        wrong = [np.abs(guess[1:last] - each)[known].mean(axis=0) for each in (now, later)]
        rows.append(np.concatenate(wrong))
    return np.array(rows)


def repeated(episodes: Sequence[swarmdata.Episode]) -> Iterator[np.ndarray]:
    """The command of the step before."""
    for episode in episodes:
        yield np.concatenate([episode.actions[:1], episode.actions[:-1]])


def constant(episodes: Sequence[swarmdata.Episode]) -> Iterator[np.ndarray]:
    """The mean command of every robot, of these episodes themselves."""
    mean = np.concatenate([each.actions for each in episodes]).mean(axis=0)
    for episode in episodes:
        yield np.broadcast_to(mean, episode.actions.shape)


def main(data: str, *runs: str) -> None:
    """Prints a table."""
    episodes = list(swarmdata.load(data))[::5]
    tables = {
        "last command": errors(episodes, repeated(episodes))[None],
        "mean command": errors(episodes, constant(episodes))[None],
    }
    for run in runs:
        found = []
        for seed in seeds_of([Path(run)]):
            with tempfile.TemporaryDirectory() as folder:
                path = swarmdata.export_policy(run, Path(folder) / "policy.py", seed.seed)
                found.append(errors(episodes, predicted(path, episodes)))
        tables[run] = np.stack(found)
    print("| | speed now (cm/s) | turn rate now (°/s) | speed in 2 s | turn rate in 2 s |")
    print("|---|---:|---:|---:|---:|")
    for name, table in tables.items():
        cells = []
        for column, scale in enumerate((100.0, 180 / np.pi) * 2):
            found_ = mean_interval(scale * table[:, :, column], bounds=AT_LEAST_ZERO)
            cells.append(f"{found_.value:.2f} [{found_.low:.2f}, {found_.high:.2f}]")
        print(f"| {name} | {' | '.join(cells)} |")


if __name__ == "__main__":
    main(*sys.argv[1:])
