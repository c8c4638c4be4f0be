"""Arguments and options that several commands have."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from swarmdata.datasets.dataset import Dataset

IdOrPath = Annotated[
    str, typer.Argument(metavar="ID_OR_PATH", help="dataset id, or a dataset's folder")
]
Workers = Annotated[
    int | None, typer.Option(min=1, help="number of processes; default: one per core")
]
Threads = Annotated[int, typer.Option(min=1, help="number of threads that step the worlds")]
Processes = Annotated[int, typer.Option(min=1, help="number of processes; 1: this one")]
Engine = Annotated[
    str,
    typer.Option(
        metavar="ENGINE",
        help="where the work is done: local, dask://HOST:PORT, slurm[:PARTITION] or ray",
    ),
]
Part = Annotated[
    str | None,
    typer.Option(metavar="K/N", help="do only every N-th piece, from the K-th on; for schedulers"),
]
Episodes = Annotated[
    int, typer.Option(min=1, help="number of evaluation episodes, each on a reserved seed")
]
Task = Annotated[
    str | None,
    typer.Option(
        help="task of policies, tiers and runs: a preset, or a spec file",
        show_default="coop_nav; of runs, that of the training",
    ),
]
Settings = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="change a setting; may be repeated"),
]
Notes = Annotated[
    list[str] | None,
    typer.Option(
        "--note",
        metavar="KEY=TEXT",
        help="information for readers of the card, such as license=mit; may be repeated",
    ),
]
Observation = Annotated[
    str | None,
    typer.Option(
        help="observation model: a name such as noise-0.05 or lidar-32, which modifies the task's "
        "own (=lidar-32: the defaults), or a YAML file",
        show_default="that of the task, the dataset or the training",
    ),
]
Communication = Annotated[
    str | None,
    typer.Option(
        help="communication model: none, perfect, a name such as lossy-30, which modifies the "
        "task's own (=lossy-30: perfect), or a YAML file",
        show_default="that of the task, the dataset or the training",
    ),
]
Backend = Annotated[
    str | None,
    typer.Option(
        help="simulator: pymunk, kinematic (without contacts) or mujoco (an extra)",
        show_default="that of the task, the dataset or the training",
    ),
]
Randomize = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME=LOW..HIGH",
        help="range of a value of each episode, such as mass=0.8..1.5, or none; may be repeated",
        show_default="that of the task, the dataset or the training",
    ),
]
Clip = Annotated[Path, typer.Option(help="file to write: .gif, .mp4 or .png")]
Validation = Annotated[
    bool, typer.Option("--validation", help="use the validation seeds, to choose settings")
]


def summary_of(made: "Dataset") -> str:
    """What a command says of a dataset that it has made."""
    counts = f"{len(made):,} episodes, {made.n_steps:,} joint steps"
    return f"{made.path}\n{counts}, digest {made.digest}"


def parse_ranges(texts: list[str] | None) -> dict[str, tuple[float, float]] | None:
    """Reads `NAME=LOW..HIGH` of all `--randomize` options; `none` means no ranges."""
    if not texts:
        return None
    ranges: dict[str, tuple[float, float]] = {}
    for text in [] if texts == ["none"] else texts:
        name, _, ends = text.partition("=")
        low, dots, high = ends.partition("..")
        try:
            span = float(low), float(high)
        except ValueError:
            dots = ""
        if not dots or name in ranges:
            raise typer.BadParameter(
                f"{text!r} is no range of its own, expected such as mass=0.8..1.5, or none alone",
                param_hint="--randomize",
            )
        ranges[name] = span
    return ranges


def parse_settings(texts: list[str] | None, option: str = "--set") -> dict[str, str]:
    """Splits the texts of all `--set` options, or of another option like it."""
    settings: dict[str, str] = {}
    for text in texts or []:
        key, equals, value = text.partition("=")
        if not equals:
            raise typer.BadParameter(f"got {text!r}, expected KEY=VALUE", param_hint=option)
        if settings.get(key, value) != value:
            raise typer.BadParameter(
                f"{key} is both {settings[key]} and {value}, expected one", param_hint=option
            )
        settings[key] = value
    return settings


def parse_part(text: str) -> tuple[int, int]:
    """Reads K and N of `--part K/N`."""
    part, slash, n_parts = text.partition("/")
    if not (slash and part.isdecimal() and n_parts.isdecimal() and 1 <= int(part) <= int(n_parts)):
        raise typer.BadParameter(
            f"got {text!r}, expected K/N with K from 1 to N, such as 2/8", param_hint="--part"
        )
    return int(part), int(n_parts)
