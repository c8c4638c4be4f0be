"""The commands that train algorithms, and that put what they learned into the package."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from swarmdata.cli.task_commands import Communication, Observation, setting

ONLINE = ("first_seed", "steps", "workers")
OFFLINE = ("updates", "regulariser", "curve_every", "keep", "frame", "device", "compile")
"""Options of `train` that only one kind of algorithm has."""

Steps = Annotated[float | None, typer.Option(min=1, help="joint steps of a seed, online")]
Regulariser = Annotated[
    str | None, typer.Option(help="of vdn and qmix, offline: none, bc, bcq or cql")
]
Config = Annotated[str | None, typer.Option(help="settings: a shipped name or a YAML file")]
Settings = Annotated[
    list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="of the algorithm")
]

FrameName = Annotated[
    str, typer.Option(help="that robots see and act in: auto, world, or an anchor, offline")
]
Compile = Annotated[bool, typer.Option(help="make kernels first, for long runs, offline")]


def train(
    context: typer.Context,
    algorithm: Annotated[str, typer.Argument(help="such as bc offline or mappo online")],
    data: Annotated[str | None, typer.Argument(metavar="[ID]", help="dataset, offline")] = None,
    task: Annotated[str | None, typer.Option(help="preset or spec's file, online")] = None,
    out: Annotated[Path | None, typer.Option(help="the run's folder; runs/ALGORITHM-DATA")] = None,
    seeds: Annotated[int, typer.Option(min=1, help="how many: 0, 1, ...")] = 4,
    first_seed: Annotated[int, typer.Option(min=0, help="another than 0, online")] = 0,
    steps: Steps = None,
    updates: Annotated[int | None, typer.Option(min=1, help="gradient updates, offline")] = None,
    regulariser: Regulariser = None,
    config: Config = None,
    settings: Settings = None,
    curve_every: Annotated[int, typer.Option(min=1, help="updates between evaluations")] = 1000,
    keep: Annotated[bool, typer.Option(help="keep all checkpoints, for `rank`, offline")] = False,
    observation: Observation = None,
    communication: Communication = None,
    frame: FrameName = "auto",
    workers: Annotated[int, typer.Option(min=1, help="processes, online")] = 1,
    device: Annotated[str, typer.Option(help="of torch, offline")] = "cpu",
    compile: Compile = False,
) -> None:
    """Train an algorithm, offline on a train split or online in a task; run again to go on.

    With other models than the recorded ones, the dataset is observed again from its states.
    """
    from swarmdata.evaluation.results.policy_names import require

    require("torch", "torch", "training")
    from swarmdata.evaluation.runs.train import train, train_online

    _check_subject(context, algorithm, data, task)
    lengths = {"n_steps": None if steps is None else round(steps), "n_updates": updates}
    changes = _changes(config, {**lengths, "regulariser": regulariser}, settings or [])
    folder = out or Path("runs") / f"{algorithm}-{Path(task or data or '').stem}"
    options: dict[str, Any] = {"observation": observation, "communication": communication}
    if task is not None:
        options |= {"seeds": range(first_seed, first_seed + seeds), "workers": workers}
        train_online(algorithm, task, folder, changes=changes, **options)
    elif data is not None:
        options |= {"curve_every": curve_every, "keep": keep, "frame": frame, "device": device}
        options["compile"] = compile
        train(algorithm, data, folder, n_seeds=seeds, changes=changes, **options)
    typer.echo(folder)


def _check_subject(
    context: typer.Context, algorithm: str, data: str | None, task: str | None
) -> None:
    """Offline algorithms train on a dataset, online ones in a task; no option goes unused."""
    from swarmdata.registry.components import OFFLINE_ALGORITHMS, ONLINE_ALGORITHMS, resolve

    resolve("algorithm", {**ONLINE_ALGORITHMS, **OFFLINE_ALGORITHMS}, algorithm)
    ways = {"a dataset's ID": OFFLINE_ALGORITHMS, "--task TASK": ONLINE_ALGORITHMS}
    wanted = " or ".join(way for way, table in ways.items() if algorithm in table)
    is_online = task is not None
    known = ONLINE_ALGORITHMS if is_online else OFFLINE_ALGORITHMS
    if (data is None) != is_online or algorithm not in known:
        raise typer.BadParameter(f"{algorithm} needs {wanted}, and nothing else to train on")
    for name in OFFLINE if is_online else ONLINE:
        source = context.get_parameter_source(name)
        if source is not None and source.name != "DEFAULT":
            option = f"--{name.replace('_', '-')}"
            place = "in a task" if is_online else "on a dataset"
            raise typer.BadParameter(f"{algorithm} has no such option {place}", param_hint=option)


def ship(
    task: Annotated[str, typer.Argument(help="a preset, such as coop_nav")],
    out: Annotated[Path, typer.Option(help="the package's behavior_policies/checkpoints")],
    medium: Annotated[list[Path] | None, typer.Option(help="online run, for mediums")] = None,
    expert: Annotated[list[Path] | None, typer.Option(help="finished online run")] = None,
    convention: Annotated[
        list[Path] | None, typer.Option(help="finished online run, for mixed-conventions")
    ] = None,
) -> None:
    """Put the mediums of online runs, their replays, and the experts of others into the package."""
    from swarmdata.evaluation.results.policy_names import require
    from swarmdata.registry.presets import preset

    require("torch", "torch", "reading online runs")
    from swarmdata.online_algos.runs.checkpoint_selection import seeds_of
    from swarmdata.online_algos.runs.checkpoint_selection import ship as ship_seeds

    mediums, experts, sided = (seeds_of(runs or []) for runs in (medium, expert, convention))
    entry = ship_seeds(mediums, experts, sided, task, preset(task), out)
    if mediums:
        typer.echo(f"{len(entry['medium'])} of {len(mediums)} seeds have a medium")
    for tier, checkpoints in entry.items():
        for each in checkpoints:
            success = 100 * each["figures"]["success"]
            typer.echo(f"{tier} {each['file']}: {success:.1f} % at {each['frames']:,} frames")


def _changes(
    config: str | None, options: Mapping[str, int | str | None], settings: list[str]
) -> dict[str, str]:
    """Settings of an algorithm as text: of a file, then of options, then of `--set`, which wins."""
    from swarmdata.evaluation.runs.train import read_settings

    changes = {name: str(value) for name, value in options.items() if value is not None}
    named = dict(setting(text) for text in settings)
    return (read_settings(config) if config else {}) | changes | named


def learning(
    runs: Annotated[list[Path], typer.Argument(help="one online run per algorithm and task")],
    out: Annotated[Path, typer.Option(help="folder of curves, table and figure")],
) -> None:
    """Write what online training achieved and what it cost."""
    from swarmdata.evaluation.results.policy_names import require

    require("torch", "torch", "reading online runs")
    from swarmdata.evaluation.results.online_report import write_online_report

    typer.echo(write_online_report(runs, out), nl=False)
