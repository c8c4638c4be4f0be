"""Frames a second of MAPPO training, beside BenchMARL's, into docs/measurements.md.

    python -m tests.benchmarks.bench_training

The runs take turns; each turn is a process of its own, pinned to a core. BenchMARL 1.5.2 is
measured if it is there; it needs an older TorchRL, and runs without what it only imports for
pictures. In a folder of its own, added to PYTHONPATH:

    pip install --no-deps --target FOLDER benchmarl==1.5.2 torchrl==0.11.1 tensordict==0.11.0 \
        vmas==1.5.2 gym==0.26.2 gym-notices hydra-core omegaconf antlr4-python3-runtime==4.9.3 \
        cloudpickle orjson pyvers importlib_metadata zipp
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1"))

import numpy as np

from tests.benchmarks.measuring import Rate, table, write_section

ROUNDS, SECONDS = 5, 2.0
"""Turns of each run, and how long one is at least, after an update that warms up."""

OUR_EPOCHS = 3
"""Passes over each frame, `MAPPOConfig.n_epochs`; BenchMARL is measured with as many as well."""

PEER_FRAMES, PEER_MINIBATCH, PEER_EPOCHS = 6000, 400, 45
"""BenchMARL 1.5.2, `conf/experiment/base_experiment.yaml`: frames of an iteration and the rest."""

PEER_COPIES, PEER_ROBOTS = 60, 3
"""Copies: 100 steps of each make an iteration. Robots: those of its `conf/task/vmas/navigation`."""

Add = Callable[[int], None]
"""Counts the frames (joint steps of one copy) of an update, all seeds together."""


class Turn(NamedTuple):
    frames: int
    seconds: float  # of the wall clock
    processor: float  # seconds of processor time, all threads


def counting() -> Add:
    """Counts from the second update on; when the turn is over, prints it and ends the process."""
    begin: list[float] = []
    counted = 0

    def add(frames: int) -> None:
        nonlocal counted
        now = [time.perf_counter(), time.process_time()]
        if not begin:
            begin.extend(now)
            return
        counted += frames
        seconds, processor = (after - before for after, before in zip(now, begin, strict=True))
        if seconds >= SECONDS:
            print(json.dumps(Turn(counted, seconds, processor)), flush=True)
            os._exit(0)

    return add


def train_ours(add: Add, n_seeds: int) -> None:
    """`mappo` on `coop_nav` with 4 robots as `swarmdata train` runs it, without evaluation."""
    from swarmdata.online_algos.mappo import MAPPOConfig
    from swarmdata.online_algos.runs.online_training import describe_run
    from swarmdata.registry.presets import preset

    run = describe_run("mappo", MAPPOConfig(), preset("coop_nav"), range(n_seeds))
    algorithm: Any = run.build(Path())
    while True:
        before = algorithm.frames
        algorithm.update()
        add(n_seeds * (algorithm.frames - before))


def train_benchmarl(add: Add, n_epochs: int) -> None:
    """BenchMARL's MAPPO on VMAS `navigation` with its own defaults, without evaluation or logs."""
    experiments: Any = import_module("benchmarl.experiment")  # a peer, not a dependency
    models: Any = import_module("benchmarl.models.mlp")
    config = experiments.ExperimentConfig.get_from_yaml()
    config.on_policy_n_envs_per_worker = PEER_COPIES
    config.on_policy_collected_frames_per_batch = PEER_FRAMES
    config.on_policy_minibatch_size = PEER_MINIBATCH
    config.on_policy_n_minibatch_iters = n_epochs
    config.max_n_frames = 10**9  # until the turn ends
    config.evaluation, config.create_json, config.loggers = False, False, []
    config.save_folder = tempfile.mkdtemp()
    task = import_module("benchmarl.environments").VmasTask.NAVIGATION.get_from_yaml()
    task.config["n_agents"] = PEER_ROBOTS
    callback = experiments.Callback()
    callback.on_train_end = lambda training, group: add(PEER_FRAMES)
    experiment = experiments.Experiment(
        task=task,
        algorithm_config=import_module("benchmarl.algorithms").MappoConfig.get_from_yaml(),
        model_config=models.MlpConfig.get_from_yaml(),
        critic_model_config=models.MlpConfig.get_from_yaml(),
        seed=0,
        config=config,
    )
    experiment.callbacks.append(callback)  # not before: it would be pickled
    experiment.run()


TRAINERS: dict[str, Callable[[Add, int], None]] = {
    "ours": train_ours,
    "benchmarl": train_benchmarl,
}

Start = tuple[str, int, int]
"""Key of `TRAINERS`, its number, and the core that it may use."""


def train(name: str, number: str, core: str) -> None:
    import torch

    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {int(core)})
    torch.set_num_threads(1)
    TRAINERS[name](counting(), int(number))


def turns_of(starts: Sequence[Start]) -> list[Turn]:
    """One turn of a run, whose processes work at the same time."""
    command = [sys.executable, "-W", "ignore", "-m", "tests.benchmarks.bench_training", "--one"]
    processes = [
        subprocess.Popen([*command, *map(str, start)], stdout=subprocess.PIPE, text=True)
        for start in starts
    ]
    said = [process.communicate()[0] for process in processes]
    return [Turn(*json.loads(text.splitlines()[-1])) for text in said]


def speed_table(turns: Mapping[str, list[list[Turn]]], peers: Sequence[str]) -> str:
    """A row for each run: rates, and how many times each peer's in the same round."""
    walls, rates = (
        {name: [sum(each.frames / each[column] for each in made) for made in its]
         for name, its in turns.items()}
        for column in (1, 2)
    )  # fmt: skip
    rows = []
    for name, its in turns.items():
        shares = [turn.processor / turn.seconds for made in its for turn in made]
        ratios = [
            Rate.of([a / b for a, b in zip(rates[name], rates[peer], strict=True)])
            for peer in peers
        ]
        core = f"{100 * np.median(shares):.0f} %"
        rows.append((name, *map(str, (Rate.of(walls[name]), core, Rate.of(rates[name]), *ratios))))
    head = ("run", "frames a second", "of its cores it got", "frames per second of processor")
    return table((*head, *(f"times {peer}" for peer in peers)), rows)


INTRO = (
    "Joint steps (frames) a second of `mappo` training on `coop_nav` with 4 robots and default "
    "settings: rollouts, updates and resets, without evaluation and files. Each process has "
    "one core; frames of stacked seeds and of both processes are added up.\n\n"
    "BenchMARL trains its MAPPO on VMAS navigation with its defaults, on one core: 3 robots, "
    f"60 copies, 6000 frames an iteration, {PEER_EPOCHS} epochs of minibatches of 400, "
    f"networks of 256 units. Ours uses each frame {OUR_EPOCHS} times, in minibatches of 2048 "
    "robot samples, with networks of 64 units; BenchMARL was therefore also measured with "
    f"{OUR_EPOCHS} epochs. Ratios compare frames per second of processor time in the same "
    "round; for two processes, two cores with one. Where a run got less than all of its cores, "
    "compare the ratios only."
)


def main() -> None:
    cores = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else [0]
    last = cores[-1]
    runs: dict[str, list[Start]] = {
        f"ours, {k} seed{'s' * (k > 1)}": [("ours", k, last)] for k in (1, 2, 4)
    }
    if len(cores) > 1:
        runs["ours, 2 processes of 2 seeds"] = [("ours", 2, core) for core in cores[-2:]]
    epochs = {"BenchMARL": PEER_EPOCHS, f"BenchMARL, {OUR_EPOCHS} epochs": OUR_EPOCHS}
    peers = tuple(epochs) if find_spec("benchmarl") else ()
    runs |= {name: [("benchmarl", epochs[name], last)] for name in peers}
    turns: dict[str, list[list[Turn]]] = {name: [] for name in runs}
    for number in range(ROUNDS):
        for name, starts in runs.items():
            turns[name].append(turns_of(starts))
            print(f"round {number + 1}, {name}: {turns[name][-1]}", flush=True)
    write_section("Training", f"{INTRO}\n\n{speed_table(turns, peers)}")


if __name__ == "__main__":
    if sys.argv[1:2] == ["--one"]:
        train(*sys.argv[2:])
    else:
        main()
