"""Frames a second of MAPPO training, beside BenchMARL's, into BENCHMARKS.md.

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
from types import TracebackType
from typing import Self

import numpy as np

from tests.benchmarks.measuring import Rate, table, write_section
from tests.benchmarks.trainers import PEER_EPOCHS, Turn

ROUNDS, SECONDS = 5, 2.0
"""Turns of each run, and how long one is at least; one of BenchMARL's is an iteration."""

SETTINGS_EPOCHS = 3
"""Passes over each frame in our defaults; BenchMARL is measured with as many as well."""

RECORDED = 621
"""Frames a second of BenchMARL with its defaults, recorded on one core of another machine."""

BUSY = 0.9
"""Below this part of its core, a run was held up by others."""


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
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self.messages, text=True,
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


def share_of_core(turns: dict[str, list[list[Turn]]]) -> float:
    """Median part of its core that a process got."""
    every = [turn for rounds in turns.values() for answers in rounds for turn in answers]
    return float(np.median([turn.processor / turn.seconds for turn in every]))


def speed_table(turns: dict[str, list[list[Turn]]], peer: str | None) -> str:
    """A row for each run; with a peer, how many times its rate in the same round."""
    rows = []
    for name, its in turns.items():
        wall, processor = rates(its)
        row = [name, str(Rate.of(wall)), str(Rate.of(processor))]
        if peer is not None:
            pairs = zip(processor, rates(turns[peer])[1], strict=True)
            row.append(str(Rate.of([ours / theirs for ours, theirs in pairs])))
        rows.append(tuple(row))
    head = ("run", "frames a second", "frames per second of processor")
    return table((*head, f"times {peer}") if peer else head, rows)


def share_table(turns: dict[str, list[list[Turn]]]) -> str:
    """Where the time goes; what a run does not tell is left out."""
    rows = []
    for name, its in turns.items():
        flat = [turn for answers in its for turn in answers]
        total = sum(turn.processor for turn in flat)
        rollout, worlds = (sum(t) / total for t in zip(*((t[3], t[4]) for t in flat), strict=True))
        known = not np.isnan(worlds)
        parts = (worlds, rollout - worlds) if known else (None, rollout)
        shown = ("—" if part is None else f"{100 * part:.0f} %" for part in (*parts, 1 - rollout))
        rows.append((name, *shown))
    return table(("run", "worlds", "rest of the rollouts", "updates"), rows)


def text(turns: dict[str, list[list[Turn]]], peer: str | None) -> str:
    """The section of BENCHMARKS.md."""
    parts = [
        "Joint steps a second of `mappo` training on `coop_nav` with 4 robots, default settings: "
        "rollouts, updates and resets, from the first update on, without evaluation and files. "
        "Seeds are stacked in one process, and their frames added. One process has one core, two "
        "have two, with two seeds each."
    ]
    if peer is None:
        parts.append(
            "BenchMARL is not installed here: no figures of it. On one core of another machine its "
            f"MAPPO on VMAS navigation made {RECORDED} frames a second with its defaults, which "
            "says nothing exact about this one."
        )
    else:
        parts.append(
            "BenchMARL: its MAPPO on VMAS navigation with its defaults, 3 robots, 60 copies, 6000 "
            f"frames an iteration, {PEER_EPOCHS} epochs of minibatches of 400, networks of 256 "
            f"units; ours has {SETTINGS_EPOCHS} epochs, minibatches of 2048 robot samples and "
            f"networks of 64. With {SETTINGS_EPOCHS} epochs BenchMARL is faster and learns less "
            f"from each frame. {RECORDED} frames a second with its defaults were recorded on one "
            "core of another machine. Ratios are of frames per second of processor in the same "
            "round, of all processes together."
        )
    part = share_of_core(turns)
    if part < BUSY:
        parts.append(
            f"**The machine was busy with other work: a process got {100 * part:.0f} % of its "
            "core. Frames a second by the clock are too low by about that, those per second of processor "
            "by what shared caches cost; ratios, taken in turns, hold better than either.**"
        )
    parts.append(speed_table(turns, peer).rstrip())
    parts.append("Where the processor time goes:\n\n" + share_table(turns).rstrip())
    return "\n\n".join(parts)


def main() -> None:
    """Measures all, on the last core and the one before."""
    cores: Sequence[int | None] = [None]
    if hasattr(os, "sched_setaffinity"):
        cores = sorted(os.sched_getaffinity(0), reverse=True)
    peer = "BenchMARL" if find_spec("benchmarl") else None
    with ExitStack() as stack:

        def start(*arguments: str, core: int | None = cores[0]) -> Trainee:
            return stack.enter_context(Trainee(arguments, core))

        runs = {f"ours, {k} seed{'s' * (k > 1)}": [start("ours", str(k))] for k in (1, 2, 4)}
        if len(cores) > 1:
            both = [*runs["ours, 2 seeds"], start("ours", "2", core=cores[1])]
            runs["ours, 2 processes of 2 seeds"] = both
        if peer is not None:
            runs[peer] = [start("benchmarl", str(PEER_EPOCHS))]
            few = [start("benchmarl", str(SETTINGS_EPOCHS))]
            runs[f"{peer}, {SETTINGS_EPOCHS} epochs"] = few
        turns = take_turns(runs)
    write_section("Training", text(turns, peer))


if __name__ == "__main__":
    main()
