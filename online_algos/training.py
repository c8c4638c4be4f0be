"""Trains MAPPO runs, and picks the shipped experts and mediums from their checkpoints.

A run folder holds `config.json`, `curve.csv` (one row per checkpoint), `actors/` (the actor at
every checkpoint, ready for exact inference) and `state.safetensors` (to continue).
"""

import csv
import json
import shutil
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor
from tqdm import tqdm

from swarmdata.behavior_policies.learned import digest_of, own_actor, save_actor
from swarmdata.errors import BuildError
from swarmdata.interfaces import Policy
from swarmdata.learn.checkpoint import load_checkpoint, save_checkpoint
from swarmdata.metrics import episode_metrics
from swarmdata.online_algos.mappo import MAPPO, Config
from swarmdata.online_algos.warm_start import Config as WarmStart
from swarmdata.online_algos.warm_start import warm_start
from swarmdata.registry import make_env, make_policy
from swarmdata.rollout import rollout
from swarmdata.seeding import evaluation_seeds
from swarmdata.spec import TaskSpec
from swarmdata.types import Float, Step

EARLY, EARLY_UPDATES, LATER_UPDATES = 0.2, 10, 50
"""Updates between checkpoints: more in the first part of training, where mediums are found."""

CURVE = ("success", "clean_success", "return", "robot_collisions", "obstacle_collisions", "length")

SELECTION_OFFSET = np.uint64(1 << 32)
"""Checkpoints are judged on reserved seeds of their own, which neither data nor evaluation use."""

MEDIUM_BAND = (0.40, 0.60)
"""Team success of a medium policy."""


def measure(policy: Policy, spec: TaskSpec, n_episodes: int) -> dict[str, float]:
    """Mean metrics of a policy on the selection seeds."""
    seeds = evaluation_seeds(n_episodes) + SELECTION_OFFSET
    env = make_env(spec, min(64, n_episodes))
    rows = [episode_metrics(episode, env.task) for episode in rollout(env, policy, seeds)]
    return {name: float(np.mean([row[name] for row in rows])) for name in CURVE}


def train_run(
    spec: TaskSpec, config: Config, seed: int, out: Path, *, n_episodes: int = 256
) -> Path:
    """Trains one run, or continues it where it stopped; returns its folder.

    Args:
        spec: the task.
        config: hyperparameters.
        seed: of the run.
        out: the run's folder.
        n_episodes: selection episodes per row of the curve.

    Raises:
        BuildError: the folder holds a run with another configuration.
    """
    torch.set_num_threads(1)
    document = {
        "algorithm": "mappo",
        "config": asdict(config),
        "seed": seed,
        "spec": spec.model_dump(mode="json"),
    }
    _claim(out, json.loads(json.dumps(document)))
    run = MAPPO(make_env(spec, config.n_copies), config, seed)
    state = out / "state.safetensors"
    if state.exists():
        run.load_state_dict(load_checkpoint(state)[0])
        _drop_rows_after(out / "curve.csv", run.frames)
    elif config.teacher:
        warm_start(run, make_policy(config.teacher, spec), WarmStart())
    with tqdm(
        total=config.n_frames, initial=run.frames, unit="frame", unit_scale=True, desc=out.name
    ) as bar:
        while run.progress < 1:
            for _ in range(EARLY_UPDATES if run.progress < EARLY else LATER_UPDATES):
                losses = run.update()
                if run.progress >= 1:
                    break
            bar.update(run.frames - bar.n)
            _write_checkpoint(run, spec, out, losses, n_episodes)
    return out


def _claim(out: Path, document: dict[str, Any]) -> None:
    (out / "actors").mkdir(parents=True, exist_ok=True)
    path = out / "config.json"
    if path.exists() and json.loads(path.read_text()) != document:
        raise BuildError(
            f"{out} holds a run with another configuration; choose another --out or delete it"
        )
    path.write_text(json.dumps(document, indent=1))


def _write_checkpoint(
    run: MAPPO, spec: TaskSpec, out: Path, losses: dict[str, float], n_episodes: int
) -> None:
    """Saves the actor, its figures, and then the state to continue from."""
    path = out / "actors" / f"{run.frames:010d}.safetensors"
    save_actor(path, run.actor_layers(), run.input_mean, run.input_scale, spec.n_agents)
    row = {
        "frames": run.frames,
        **measure(own_actor(path, spec), spec, n_episodes),
        **losses,
        "std": run.std,
    }
    curve = out / "curve.csv"
    new = not curve.exists()
    with curve.open("a", newline="") as file:
        writer = csv.DictWriter(file, list(row), lineterminator="\n")
        if new:
            writer.writeheader()
        writer.writerow({name: f"{value:.6g}" for name, value in row.items()})
    save_checkpoint(out / "state.safetensors", run.state_dict(), {"frames": run.frames})
    run.restart_worlds()  # as a run does that continues from this state


def _drop_rows_after(curve: Path, frames: int) -> None:
    """Removes rows that a killed process wrote after its last saved state."""
    lines = curve.read_text().splitlines(keepends=True)
    kept = [line for line in lines[1:] if float(line.split(",", 1)[0]) <= frames]
    curve.write_text("".join(lines[:1] + kept))


def read_curve(run: Path) -> list[dict[str, float]]:
    """The rows of a run's `curve.csv`."""
    with (run / "curve.csv").open(newline="") as file:
        return [{name: float(value) for name, value in row.items()} for row in csv.DictReader(file)]


def find_medium(run: Path, spec: TaskSpec, n_episodes: int = 1024) -> tuple[Path, dict[str, float]]:
    """The first checkpoint whose team success lies in `MEDIUM_BAND`, on `n_episodes` episodes.

    Raises:
        BuildError: no checkpoint lies in the band.
    """
    low, high = MEDIUM_BAND
    for row in read_curve(run):
        if low - 0.1 <= row["success"] <= high + 0.1:  # few episodes: a rough sieve
            path = run / "actors" / f"{int(row['frames']):010d}.safetensors"
            figures = measure(own_actor(path, spec), spec, n_episodes)
            if low <= figures["success"] <= high:
                return path, figures
    raise BuildError(f"no checkpoint of {run} has a team success in {MEDIUM_BAND}; train it longer")


def last_actor(run: Path, spec: TaskSpec, n_episodes: int = 1024) -> tuple[Path, dict[str, float]]:
    """The actor at the end of a run, its figures, and what exact inference changes in its actions.

    Raises:
        BuildError: the run is not finished.
    """
    path = max((run / "actors").glob("*.safetensors"))
    wanted = json.loads((run / "config.json").read_text())["config"]["n_frames"]
    if int(path.stem) < wanted:
        raise BuildError(
            f"{run} has {path.stem} of {wanted} frames; run its command again to go on"
        )
    figures = measure(own_actor(path, spec), spec, n_episodes)
    return path, figures | {"exact_error": exact_error(run, spec)}


def exact_error(run: Path, spec: TaskSpec, n_episodes: int = 64) -> float:
    """Largest difference of an action component between exact inference and the float32 network.

    Both see the observations of the selection episodes, played by the exact policy.

    Args:
        run: a finished run; its last saved state holds the float32 weights.
        spec: the task.
        n_episodes: how many.
    """
    path = max((run / "actors").glob("*.safetensors"))
    state = load_checkpoint(run / "state.safetensors")[0]
    policy, env = own_actor(path, spec), make_env(spec, n_episodes)
    step = env.reset(evaluation_seeds(n_episodes) + SELECTION_OFFSET)
    worst = 0.0
    while not step.ended.all():
        actions = policy.act(step)
        difference = np.abs(_float_actions(state, step) - actions)[~step.ended]
        worst = max(worst, float(difference.max()))
        step = env.step(actions)
    return worst


def _float_actions(state: dict[str, Tensor], step: Step) -> Float:
    """Actions of the float32 network in a saved state, clipped to [-1, 1], [E, N, A]."""
    e, n = step.rewards.shape
    x = (torch.from_numpy(step.observations) - state["input.mean"]) * state["input.scale"]
    x = torch.cat([x, torch.eye(n).expand(e, n, n)], -1)
    weights = [name for name in state if name.startswith("actor.") and name.endswith(".weight")]
    for k, name in enumerate(sorted(weights)):
        x = torch.nn.functional.linear(x, state[name], state[name.replace("weight", "bias")])
        x = x.relu() if k < len(weights) - 1 else x.clamp(-1, 1)
    return x.numpy()


def ship(
    mediums: Sequence[Path], experts: Sequence[Path], spec: TaskSpec, folder: Path
) -> dict[str, list[dict[str, Any]]]:
    """Copies the medium of some runs and the last actor of others, with their curves.

    Args:
        mediums: runs from which the first checkpoint in the band is taken.
        experts: finished runs.
        spec: the task.
        folder: the package's `behavior_policies/checkpoints`; its `index.json` is updated.

    Returns:
        The task's entry of the index.
    """
    chosen = [("medium", run, *find_medium(run, spec)) for run in mediums]
    chosen += [("expert", run, *last_actor(run, spec)) for run in experts]
    entry: dict[str, list[dict[str, Any]]] = {"medium": [], "expert": []}
    folder.mkdir(parents=True, exist_ok=True)
    for tier, run, source, figures in chosen:
        name = f"{spec.task}-{tier}-{len(entry[tier])}"
        target = folder / f"{name}.safetensors"
        shutil.copyfile(source, target)
        shutil.copyfile(run / "curve.csv", folder / f"{name}.csv")
        about = {"file": target.name, "sha256": digest_of(target), "frames": int(source.stem)}
        entry[tier].append(about | {"figures": figures})
    index = folder / "index.json"
    table = json.loads(index.read_text()) if index.exists() else {}
    index.write_text(json.dumps(table | {spec.task: entry}, indent=1, sort_keys=True) + "\n")
    return entry
