"""What online training achieved and what it cost: curves, one table, one figure."""

import csv
import io
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from swarmdata.drawing import markdown
from swarmdata.errors import SchemaError
from swarmdata.evaluation.results.curve_plots import plot_learning
from swarmdata.evaluation.results.learning_curves import group_files
from swarmdata.learn.training.run_files import CURVE, SPEED
from swarmdata.learn.training.run_folder import read_table
from swarmdata.online_algos.runs.checkpoint_selection import seeds_of
from swarmdata.online_algos.runs.online_training import read_online_run
from swarmdata.registry.presets import name_of
from swarmdata.rollouts.score_statistics import bootstrap, mean
from swarmdata.runtime.atomic import write_file

GOAL = 0.9
"""Team success that counts as having learned the task."""

HEAD = (
    "task", "algorithm", "seeds", "joint steps", "success", "clean success", "return",
    "seeds that reached 90 %", "wall-clock", "joint steps a second", "memory of a process",
)  # fmt: skip

Row = dict[str, float]


class Training(NamedTuple):
    """The runs of one algorithm in one task, of one or several processes."""

    task: str  # a preset's name where the spec is one
    algorithm: str
    rows: tuple[tuple[Row, ...], ...]  # of the curve, for each seed
    speeds: tuple[tuple[Row, ...], ...]  # of `speed.csv`, for each process


def read_training(run: Path) -> Training:
    """Reads a run folder, or a folder of the runs of several processes.

    Raises:
        BuildError: it holds no run.
        SchemaError: its processes trained different things.
    """
    folders = list(dict.fromkeys(seed.folder for seed in seeds_of([run])))
    runs = [read_online_run(folder) for folder in folders]
    kinds = {(each.spec.task, each.algorithm, each.spec.hash()) for each in runs}
    if len(kinds) > 1:
        raise SchemaError(f"{run} holds {len(kinds)} different trainings, expected one")
    tracks = []
    for folder, each in zip(folders, runs, strict=True):
        rows = read_table(folder / CURVE)
        tracks += [tuple(row for row in rows if row["seed"] == seed) for seed in each.seeds]
    speeds = tuple(tuple(read_table(folder / SPEED)) for folder in folders)
    return Training(name_of(runs[0].spec), runs[0].algorithm, tuple(tracks), speeds)


def write_online_report(runs: Sequence[Path], out: Path) -> str:
    """Writes `<task>-<algorithm>.csv` for each run, `table.md` and `learning.png`.

    Args:
        runs: folders, one for each algorithm and task.
        out: folder to write to.

    Returns:
        The table, as Markdown.

    Raises:
        BuildError: a folder holds no run.
        SchemaError: two runs are of one algorithm in one task, or processes of a run differ.
    """
    trainings = [read_training(run) for run in runs]
    for name, count in Counter(f"{t.algorithm} in {t.task}" for t in trainings).items():
        if count > 1:
            raise SchemaError(
                f"{count} of the runs trained {name}, expected one. Leave out the others, or put "
                "seeds of one training into folders seeds-... of one run."
            )
    out.mkdir(parents=True, exist_ok=True)
    files = []
    for training in trainings:
        files.append(out / f"{training.task}-{training.algorithm}.csv")
        write_file(files[-1], _curve(training))
    table = markdown.table(HEAD, [_cells(training) for training in trainings])
    write_file(out / "table.md", table.encode())
    plot_learning(group_files(files, "task-algorithm"), out / "learning.png")
    return table


def _curve(training: Training) -> bytes:
    """All rows of all seeds in one table, by time."""
    rows = sorted(
        (row for track in training.rows for row in track),
        key=lambda row: (row["frames"], row["seed"]),
    )
    names = list(dict.fromkeys(name for row in rows for name in row))
    text = io.StringIO()
    writer = csv.DictWriter(text, names, lineterminator="\n")
    writer.writeheader()
    writer.writerows({name: f"{value:.6g}" for name, value in row.items()} for row in rows)
    return text.getvalue().encode()


def _cells(training: Training) -> tuple[str, ...]:
    frames = max(int(row["frames"]) for track in training.rows for row in track)
    firsts = [
        next((row["frames"] for row in track if row["success"] >= GOAL), None)
        for track in training.rows
    ]
    reached = [first for first in firsts if first is not None]
    when = f" (first at {min(reached):,.0f})" if reached else ""
    seconds = max(sum(row["seconds"] for row in speed) for speed in training.speeds)
    rates = [
        frames * speed[0]["n_seeds"] / sum(row["seconds"] for row in speed)
        for speed in training.speeds
    ]
    memory = max(row["memory_mb"] for speed in training.speeds for row in speed)
    return (
        f"`{training.task}`",
        f"`{training.algorithm}`",
        str(len(training.rows)),
        f"{frames:,}",
        _interval(training, "success", 100.0, " %"),
        _interval(training, "clean_success", 100.0, " %"),
        _interval(training, "return", 1.0, ""),
        f"{len(reached)} of {len(firsts)}{when}",
        f"{seconds / 60:.1f} min in {len(rates)} processes",
        f"{sum(rates):,.0f}",
        f"{memory / 1000:.1f} GB",
    )


def _interval(training: Training, metric: str, factor: float, unit: str) -> str:
    """Mean over seeds at the end of training, with its 95 % bootstrap interval."""
    last = np.array([[track[-1][metric]] for track in training.rows])
    found = bootstrap(mean, last, generator=np.random.Generator(np.random.PCG64(0)))
    value, low, high = (factor * each for each in (found.value, found.low, found.high))
    digits = 1 if factor > 1 else 2
    return f"{value:.{digits}f} [{low:.{digits}f}, {high:.{digits}f}]{unit}"
