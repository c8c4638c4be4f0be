"""Frames a second of MAPPO training, beside BenchMARL's, into docs/measurements.md.

    python -m tests.benchmarks.bench_training

Every run is a process of its own, pinned to a core, that works in turns. BenchMARL 1.5.2 is
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
from collections.abc import Sequence
from contextlib import ExitStack
from importlib.util import find_spec
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np

from tests.benchmarks.measuring import Rate, table, write_section
from tests.benchmarks.trainers import PEER_EPOCHS, Turn

ROUNDS, SECONDS = 5, 2.0
"""Turns of each run, and how long one is at least; one of BenchMARL's is an iteration."""

OUR_EPOCHS = 3
"""Passes over each frame, `MAPPOConfig.n_epochs`; BenchMARL is measured with as many as well."""


class Trainee:
    """A process that trains when told to.

    Args:
        arguments: of `tests.benchmarks.trainers`.
        core: that it may use; None where processes cannot be pinned.
    """

    def __init__(self, arguments: Sequence[str], core: int | None) -> None:
        self.arguments = tuple(arguments)
        self.messages = tempfile.TemporaryFile("w+")  # noqa: SIM115 (closed in __exit__)
        self.process = subprocess.Popen(
            [sys.executable, "-W", "ignore", "-m", "tests.benchmarks.trainers", *arguments],
            cwd=Path(__file__).parents[2], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            stderr=self.messages, text=True,
        )  # fmt: skip
        if core is not None:
            os.sched_setaffinity(self.process.pid, {core})

    def begin(self, seconds: float) -> None:
        """Tells it to train for so long."""
        assert self.process.stdin is not None
        try:
            self.process.stdin.write(f"{seconds}\n")
            self.process.stdin.flush()
        except BrokenPipeError:
            return  # it is dead; `end` says why

    def end(self) -> Turn:
        """Waits for its answer.

        Raises:
            RuntimeError: it died, with what it said last.
        """
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        if not line:
            code = self.process.wait()
            self.messages.seek(0)
            last = "".join(self.messages.readlines()[-20:])
            raise RuntimeError(
                f"trainer {self.arguments} ended with code {code}, and said:\n{last}"
            )
        return Turn(*json.loads(line))

    def __enter__(self) -> Self:
        """Itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        at: TracebackType | None,
    ) -> None:
        """Ends the process: it holds nothing worth keeping."""
        self.process.kill()
        self.process.communicate()
        self.messages.close()


def take_turns(
    runs: dict[str, list[Trainee]], rounds: int = ROUNDS, seconds: float = SECONDS
) -> dict[str, list[list[Turn]]]:
    """Every run in every round, the processes of one run together; one round before warms up."""
    turns: dict[str, list[list[Turn]]] = {name: [] for name in runs}
    for number in range(-1, rounds):
        for name, trainees in runs.items():
            for trainee in trainees:
                trainee.begin(0.0 if number < 0 else seconds)
            answers = [trainee.end() for trainee in trainees]
            if number >= 0:
                turns[name].append(answers)
                wall = sum(turn.per_second for turn in answers)
                print(f"round {number + 1}, {name}: {wall:.0f} frames a second", flush=True)
    return turns


def rates(turns: list[list[Turn]]) -> tuple[list[float], list[float]]:
    """Of each round: frames a second by the clock, and by the processor; processes are added."""
    return (
        [sum(turn.per_second for turn in answers) for answers in turns],
        [sum(turn.per_processor_second for turn in answers) for answers in turns],
    )


def share_of_core(its: list[list[Turn]]) -> float:
    """Median part of its core that each process of a run got."""
    every = [turn.processor / turn.seconds for answers in its for turn in answers]
    return float(np.median(every))


def speed_table(turns: dict[str, list[list[Turn]]], peers: Sequence[str]) -> str:
    """A row for each run: rates, and how many times each peer's in the same round."""
    rows = []
    for name, its in turns.items():
        wall, processor = rates(its)
        ratios = [
            Rate.of([a / b for a, b in zip(processor, rates(turns[peer])[1], strict=True)])
            for peer in peers
        ]
        core = f"{100 * share_of_core(its):.0f} %"
        rows.append((name, *map(str, (Rate.of(wall), core, Rate.of(processor), *ratios))))
    head = ("run", "frames a second", "of its cores it got", "frames per second of processor")
    return table((*head, *(f"times {peer}" for peer in peers)), rows)


def text(turns: dict[str, list[list[Turn]]], peers: Sequence[str]) -> str:
    """The section of docs/measurements.md."""
    parts = [
        "Joint steps (frames) a second of `mappo` training on `coop_nav` with 4 robots and default "
        "settings: rollouts, updates and resets, without evaluation and files. Each process has "
        "one core; frames of stacked seeds and of both processes are added up.",
        "BenchMARL trains its MAPPO on VMAS navigation with its defaults, on one core: 3 robots, "
        f"60 copies, 6000 frames an iteration, {PEER_EPOCHS} epochs of minibatches of 400, "
        f"networks of 256 units. Ours uses each frame {OUR_EPOCHS} times, in minibatches of 2048 "
        "robot samples, with networks of 64 units; BenchMARL was therefore also measured with "
        f"{OUR_EPOCHS} epochs. Ratios compare frames per second of processor time in the same "
        "round; for two processes, two cores with one. Where a run got less than all of its cores, "
        "compare the ratios only.",
    ]
    parts.append(speed_table(turns, peers).rstrip())
    return "\n\n".join(parts)


def main() -> None:
    """Measures all, on the last core and the one before."""
    if not find_spec("torch"):
        print("torch is not installed: training is not measured")
        return
    cores: Sequence[int | None] = [None]
    if hasattr(os, "sched_setaffinity"):
        cores = sorted(os.sched_getaffinity(0), reverse=True)
    peers = {"BenchMARL": PEER_EPOCHS, f"BenchMARL, {OUR_EPOCHS} epochs": OUR_EPOCHS}
    if not find_spec("benchmarl"):
        peers = {}
    with ExitStack() as stack:

        def start(*arguments: str, core: int | None = cores[0]) -> Trainee:
            return stack.enter_context(Trainee(arguments, core))

        runs = {f"ours, {k} seed{'s' * (k > 1)}": [start("ours", str(k))] for k in (1, 2, 4)}
        if len(cores) > 1:
            both = [*runs["ours, 2 seeds"], start("ours", "2", core=cores[1])]
            runs["ours, 2 processes of 2 seeds"] = both
        runs |= {name: [start("benchmarl", str(epochs))] for name, epochs in peers.items()}
        turns = take_turns(runs)
    write_section("Training", text(turns, tuple(peers)))


if __name__ == "__main__":
    main()
