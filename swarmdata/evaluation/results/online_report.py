"""The results and the cost of online training: learning curves, a table and a figure."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from swarmdata.drawing import markdown
from swarmdata.errors import SchemaError
from swarmdata.evaluation.results.estimate_table import to_csv
from swarmdata.evaluation.results.learning_curves import plot_learning
from swarmdata.learn.training.run_files import CURVE, SPEED, read_table, seeds_of
from swarmdata.online_algos.runs.online_training import read_online_run
from swarmdata.registry.presets import name_of
from swarmdata.rollouts.score_intervals import SHARE, UNBOUNDED, seed_interval
from swarmdata.runtime.output_folder import OutputKind, check_output, filled, remove_others
from swarmdata.specs.origins import SideSpec
from swarmdata.specs.task_spec import TaskSpec

TRAINING_REPORT = OutputKind("training report")

LEARNED_SUCCESS = 0.9  # team success that counts as having learned the task

COLUMNS = (
    "task", "algorithm", "seeds", "joint steps", "success", "clean success", "return",
    "seeds that reached 90 %", "wall-clock time", "joint steps per second", "peak memory",
)  # fmt: skip

Row = dict[str, float]


class Training(NamedTuple):
    """The runs of an algorithm in a task, from one or several processes."""

    task: str  # a preset's name where the spec is one
    algorithm: str
    curves: tuple[tuple[Row, ...], ...]  # rows of `curve.csv`, for each seed
    speeds: tuple[tuple[Row, ...], ...]  # rows of `speed.csv`, for each process


def read_training(run: Path) -> Training:
    """Reads a run folder, or a folder with the runs of several processes.

    Raises:
        BuildError: the folder holds no run.
    """
    folders = list(dict.fromkeys(seed.folder for seed in seeds_of([run])))
    runs = [read_online_run(folder) for folder in folders]
    kinds = {(each.spec.task, each.algorithm, each.spec.hash()) for each in runs}
    if len(kinds) > 1:
        raise SchemaError(
            f"{run} has runs of {len(kinds)} different tasks, specs or algorithms, expected one"
        )
    curves = []
    for folder, each in zip(folders, runs, strict=True):
        rows = read_table(folder / CURVE)
        curves += [tuple(row for row in rows if row["seed"] == seed) for seed in each.seeds]
    speeds = tuple(tuple(read_table(folder / SPEED)) for folder in folders)
    return Training(_name(runs[0].spec), runs[0].algorithm, tuple(curves), speeds)


def _name(spec: TaskSpec | SideSpec) -> str:
    """As files are named."""
    if isinstance(spec, SideSpec):
        return f"{name_of(spec.whole)}-{spec.side}-vs-{spec.opponents}"
    return name_of(spec)


def write_online_report(runs: Sequence[Path], out: Path, *, suffix: str = ".png") -> str:
    """Writes `<task>-<algorithm>.csv` for each run, `table.md` and the figure; returns the table.

    Raises:
        OutputError: `out` has files that no such report wrote.
        BuildError: a folder holds no run.
    """
    check_output(out, TRAINING_REPORT)
    trainings = [read_training(run) for run in runs]
    for name, count in Counter(f"{t.algorithm} in {t.task}" for t in trainings).items():
        if count > 1:
            raise SchemaError(
                f"{count} of the runs trained {name}, expected one. Leave out the others, or move "
                "the seeds of one training into folders seeds-... of one run."
            )
    table = markdown.table(COLUMNS, [_cells(training) for training in trainings])
    with filled(out, TRAINING_REPORT) as folder:
        files: dict[str, dict[str, list[Path]]] = {}
        for training in trainings:
            file = folder / f"{training.task}-{training.algorithm}.csv"
            rows = [row for curve in training.curves for row in curve]
            rows.sort(key=lambda row: (row["frames"], row["seed"]))
            file.write_bytes(to_csv(rows, ".6g").encode())
            files.setdefault(training.task, {})[training.algorithm] = [file]
        (folder / "table.md").write_text(table, encoding="utf-8")
        plot_learning(files, folder / f"learning{suffix}")
        kept = {path.name for path in folder.iterdir()}
    remove_others(out, TRAINING_REPORT, kept)
    return table


def _cells(training: Training) -> tuple[str, ...]:
    frames = max(int(row["frames"]) for curve in training.curves for row in curve)
    firsts = [
        next((row["frames"] for row in curve if row["success"] >= LEARNED_SUCCESS), None)
        for curve in training.curves
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
        str(len(training.curves)),
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
    """Mean over seeds at the end of training; its 95 % interval is for new training seeds."""
    last = np.array([curve[-1][metric] for curve in training.curves])
    value, *ends = seed_interval(last, bounds=SHARE if unit else UNBOUNDED)
    digits = 1 if unit else 2
    low, high = (f"{factor * each:.{digits}f}" for each in ends)
    text = f"{factor * value:.{digits}f}"
    return f"{text}{unit}" if len(last) == 1 else f"{text} [{low}, {high}]{unit}"
