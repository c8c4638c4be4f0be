"""A training run in a process of its own that works when told to, and says how much it did.

    python -m tests.benchmarks.trainers {ours N_SEEDS | benchmarl N_EPOCHS}

Each line on its standard input is a number of seconds: it makes whole updates for at least so long
and answers with one line, a `Turn` as JSON. It ends when its standard input ends.
"""

import json
import os
import sys
import tempfile
import time
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple, TextIO

os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1"))

PEER_FRAMES, PEER_MINIBATCH, PEER_EPOCHS = 6000, 400, 45
"""BenchMARL 1.5.2, `conf/experiment/base_experiment.yaml`: frames of an iteration and the rest."""

PEER_COPIES, PEER_ROBOTS = 60, 3
"""Copies: 100 steps of each make an iteration. Robots: those of its `conf/task/vmas/navigation`."""


class Turn(NamedTuple):
    """What one process did in one turn."""

    frames: int  # joint steps of one copy, all seeds together
    seconds: float  # of the wall clock
    processor: float  # seconds of processor time, all threads

    @property
    def per_second(self) -> float:
        """Frames a second of the wall clock."""
        return self.frames / self.seconds

    @property
    def per_processor_second(self) -> float:
        """Frames a second of processor time."""
        return self.frames / self.processor


class Meter:
    """Waits for turns and answers them."""

    def __init__(self, orders: TextIO, answers: TextIO) -> None:
        self.orders, self.answers = orders, answers
        self.begin()

    def begin(self) -> None:
        """Waits for the next turn.

        Raises:
            SystemExit: there is none.
        """
        line = self.orders.readline()
        if not line:
            sys.exit(0)
        self.wanted = float(line)
        self.frames = 0
        self.wall, self.processor = time.perf_counter(), time.process_time()

    def add(self, frames: int) -> None:
        """Counts one update; answers if the turn is over, and then waits for the next."""
        self.frames += frames
        seconds = time.perf_counter() - self.wall
        if seconds < self.wanted:
            return
        spent = time.process_time() - self.processor
        turn = Turn(self.frames, seconds, spent)
        self.answers.write(json.dumps(turn) + "\n")
        self.answers.flush()
        self.begin()


def train_ours(meter: Meter, n_seeds: int) -> None:
    """`mappo` on `coop_nav` with 4 robots as `swarmdata train` runs it, without evaluation."""
    from swarmdata.online_algos.mappo import MAPPOConfig
    from swarmdata.online_algos.runs.online_training import describe_run
    from swarmdata.registry.presets import preset

    run = describe_run("mappo", MAPPOConfig(), preset("coop_nav"), range(n_seeds))
    algorithm: Any = run.build(Path())
    while True:
        before = algorithm.frames
        algorithm.update()
        meter.add(n_seeds * (algorithm.frames - before))


def train_benchmarl(meter: Meter, n_epochs: int) -> None:
    """BenchMARL's MAPPO on VMAS `navigation` with its own defaults, without evaluation or logs."""
    experiments: Any = import_module("benchmarl.experiment")  # a peer, not a dependency
    models: Any = import_module("benchmarl.models.mlp")
    config = experiments.ExperimentConfig.get_from_yaml()
    config.on_policy_n_envs_per_worker = PEER_COPIES
    config.on_policy_collected_frames_per_batch = PEER_FRAMES
    config.on_policy_minibatch_size = PEER_MINIBATCH
    config.on_policy_n_minibatch_iters = n_epochs
    config.max_n_frames = 10**9  # until the turns end
    config.evaluation, config.create_json, config.loggers = False, False, []
    task = import_module("benchmarl.environments").VmasTask.NAVIGATION.get_from_yaml()
    task.config["n_agents"] = PEER_ROBOTS
    callback = experiments.Callback()

    def on_train_end(training: Any, group: str) -> None:
        meter.add(PEER_FRAMES)

    callback.on_train_end = on_train_end
    with tempfile.TemporaryDirectory() as folder:
        config.save_folder = folder
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


TRAINERS: dict[str, Callable[[Meter, int], None]] = {
    "ours": train_ours,
    "benchmarl": train_benchmarl,
}


def main() -> None:
    """Trains until the orders end."""
    name, number = sys.argv[1:]
    train = TRAINERS[name]
    import torch

    torch.set_num_threads(1)
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # whatever else prints must not garble the answers
    train(Meter(sys.stdin, answers), int(number))


if __name__ == "__main__":
    main()
