"""`swarmdata train`, `ship`, `learning`, `export-policy`: runs, checkpoints, reports, robots."""

from pathlib import Path
from typing import Annotated, Any

import typer

from swarmdata.cli.option_use import given, refuse, refuse_workers
from swarmdata.cli.shared_options import (
    Communication,
    Engine,
    Observation,
    Part,
    Processes,
    Randomize,
    Settings,
    parse_part,
    parse_ranges,
    parse_settings,
)

ONLINE_OPTIONS = (
    "first_seed",
    "steps",
    "checkpoints",
    "start",
    "recorded",
    "offline_share",
    "threads",
    "randomize",
)
OFFLINE_OPTIONS = (
    "updates", "regulariser", "curve_every", "keep", "reward", "frame", "device", "compile",
)  # fmt: skip
"""Options of `train` that only one kind of algorithm has."""

Steps = Annotated[float | None, typer.Option(min=1, help="online: joint steps of each seed")]
Regulariser = Annotated[str | None, typer.Option(help="offline vdn and qmix: none, bc, bcq or cql")]
Reward = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME=WEIGHT", help="offline: weight of a reward term, may be repeated; or safe"
    ),
]
Config = Annotated[str | None, typer.Option(help="settings: a shipped file's name, or a YAML file")]
FrameName = Annotated[str, typer.Option(help="offline: robots' frame: auto, world, or an anchor")]
Data = Annotated[
    str | None,
    typer.Argument(metavar="[ID]", help="offline: dataset id or folder; ID=0.8,ID=0.2 mixes"),
]
Start = Annotated[Path | None, typer.Option(help="online: folder of an offline run to begin with")]
Recorded = Annotated[
    str | None,
    typer.Option("--data", metavar="ID", help="online: dataset to mix into the batches"),
]
Share = Annotated[float, typer.Option(help="online: part of each batch that --data gives")]
Device = Annotated[str, typer.Option(help="offline: torch device")]
CurveEvery = Annotated[int, typer.Option(min=1, help="offline: updates between two evaluations")]
Checkpoints = Annotated[int, typer.Option(min=1, help="online: evaluations on the way")]
Threads = Annotated[int, typer.Option(min=1, help="online: threads that step the worlds")]
Compile = Annotated[bool, typer.Option(help="offline: compile with torch.compile, for long runs")]


def train(
    context: typer.Context,
    algorithm: Annotated[str, typer.Argument(help="such as bc (offline) or mappo (online)")],
    data: Data = None,
    task: Annotated[str | None, typer.Option(help="online: preset or spec file")] = None,
    out: Annotated[Path | None, typer.Option(help="run folder; runs/ALGORITHM-DATA")] = None,
    seeds: Annotated[int, typer.Option(min=1, help="number of seeds: 0, 1, ...")] = 4,
    first_seed: Annotated[int, typer.Option(min=0, help="online: first seed")] = 0,
    steps: Steps = None,
    checkpoints: Checkpoints = 40,
    start: Start = None,
    recorded: Recorded = None,
    offline_share: Share = 0.5,
    updates: Annotated[int | None, typer.Option(min=1, help="offline: gradient updates")] = None,
    regulariser: Regulariser = None,
    config: Config = None,
    settings: Settings = None,
    curve_every: CurveEvery = 1000,
    keep: Annotated[bool, typer.Option(help="offline: keep all checkpoints, for `rank`")] = False,
    observation: Observation = None,
    communication: Communication = None,
    randomize: Randomize = None,
    reward: Reward = None,
    frame: FrameName = "auto",
    workers: Processes = 1,
    engine: Engine = "local",
    part: Part = None,
    threads: Threads = 1,
    device: Device = "cpu",
    compile: Compile = False,
) -> None:
    """Train an algorithm, offline on a dataset or online in a task.

    Offline training uses the train split; with --observation or --communication, the dataset is
    re-observed from its states, and with --reward, its rewards are computed from their terms. An
    interrupted training resumes: run the same command again. Online training may begin with the
    networks of an offline run (--start) and mix recorded data into its batches (--data). Several
    processes train groups of the seeds in folders OUT/seeds-..., as --part K/N trains the K-th.
    """
    _check_arguments(context, algorithm, data, task)
    _check_processes(context, engine, part)
    changes = _changes(config, settings, n_steps=steps, n_updates=updates, regulariser=regulariser)
    ids, weights = _datasets(recorded if data is None else data)
    folder = out or _default_folder(algorithm, task or ids)
    shared = {
        "observation": observation, "communication": communication, "weights": weights,
        "changes": changes, "workers": workers, "engine": engine, "part": _group(part),
    }  # fmt: skip
    if task is not None:
        _trainers().train_online(
            algorithm, task, folder, seeds=range(first_seed, first_seed + seeds), start=start,
            data=ids, offline_share=offline_share, n_threads=threads, n_checkpoints=checkpoints,
            randomization=parse_ranges(randomize), **shared,
        )  # fmt: skip
    elif data is not None:
        _trainers().train(
            algorithm, ids or data, folder, n_seeds=seeds, curve_every=curve_every, keep=keep,
            frame=frame, device=device, compile=compile, rewards=_rewards(reward), **shared,
        )  # fmt: skip
    typer.echo(folder)


def _check_processes(context: typer.Context, engine: str, part: str | None) -> None:
    """Refuses options of processes that have no effect."""
    refuse_workers(context, engine)
    if part is not None:
        refuse(context, ("workers", "engine"), "with --part")


def _group(part: str | None) -> tuple[int, int] | None:
    return None if part is None else parse_part(part)


def _trainers() -> Any:
    """Returns the module that trains, offline and online, which needs an extra."""
    from swarmdata.runtime.extras import require_extra

    require_extra("torch", "torch", "training")
    from swarmdata.evaluation.runs import train

    return train


def _default_folder(algorithm: str, sources: str | list[str] | None) -> Path:
    """Returns the run folder that is named after the algorithm and the task or datasets."""
    names = [sources] if isinstance(sources, str) else sources or []
    return Path("runs") / f"{algorithm}-{'+'.join(Path(name).stem for name in names)}"


def _check_arguments(
    context: typer.Context, algorithm: str, data: str | None, task: str | None
) -> None:
    """Refuses an algorithm without its dataset or task, and options that it would ignore."""
    from swarmdata.registry.components import OFFLINE_ALGORITHMS, ONLINE_ALGORITHMS, resolve

    resolve("algorithm", {**ONLINE_ALGORITHMS, **OFFLINE_ALGORITHMS}, algorithm)
    sources = {"a dataset's ID": OFFLINE_ALGORITHMS, "--task TASK": ONLINE_ALGORITHMS}
    wanted = " or ".join(name for name, table in sources.items() if algorithm in table)
    is_online = task is not None
    known = ONLINE_ALGORITHMS if is_online else OFFLINE_ALGORITHMS
    if (data is None) != is_online or algorithm not in known:
        raise typer.BadParameter(f"{algorithm} needs {wanted}; not both ID and --task")
    place = "in a task" if is_online else "on a dataset"
    unused = OFFLINE_OPTIONS if is_online else ONLINE_OPTIONS
    refuse(context, unused, f"when {algorithm} learns {place}")
    if not given(context, "recorded"):
        refuse(context, ("offline_share",), "without --data")


def _datasets(text: str | None) -> tuple[str | list[str] | None, list[float] | None]:
    """Reads an id, or a mixture, `ID,ID,...` or `ID=WEIGHT,ID=WEIGHT,...`: ids and weights."""
    if text is None or "," not in text:
        return text, None
    parts = [each.partition("=") for each in text.split(",")]
    ids = [name for name, _, _ in parts]
    if not any(equals for _, equals, _ in parts):
        return ids, None
    try:
        return ids, [float(weight) for _, _, weight in parts]
    except ValueError as error:
        raise typer.BadParameter(
            f"{text!r} has no number for each dataset; expected ID=WEIGHT,ID=WEIGHT,..."
        ) from error


def _rewards(texts: list[str] | None) -> dict[str, str] | str:
    """Reads the rewards to learn from: the name of a set, such as safe, or NAME=WEIGHT, ..."""
    if texts and len(texts) == 1 and "=" not in texts[0]:
        return texts[0]
    return parse_settings(texts, "--reward")


def ship(
    task: Annotated[str, typer.Argument(help="preset, such as coop_nav")],
    out: Annotated[Path, typer.Option(help="the package's folder behavior_policies/checkpoints")],
    medium: Annotated[
        list[Path] | None, typer.Option(help="online run for medium policies; may be repeated")
    ] = None,
    expert: Annotated[
        list[Path] | None, typer.Option(help="finished online run for experts; may be repeated")
    ] = None,
    convention: Annotated[
        list[Path] | None,
        typer.Option(help="finished online run for mixed-conventions; may be repeated"),
    ] = None,
) -> None:
    """Add checkpoints of online runs to the package.

    Takes medium policies with their replays from some runs, and experts from others.
    """
    from swarmdata.registry.presets import preset
    from swarmdata.runtime.extras import require_extra

    require_extra("torch", "torch", "reading online runs")
    from swarmdata.online_algos.runs.checkpoint_selection import seeds_of
    from swarmdata.online_algos.runs.checkpoint_selection import ship as ship_seeds

    mediums, experts, sided = (seeds_of(runs or []) for runs in (medium, expert, convention))
    entry = ship_seeds(mediums, experts, sided, task, preset(task), out)
    if mediums:
        typer.echo(f"{len(entry['medium'])} of {len(mediums)} seeds have a medium policy")
    for tier, checkpoints in entry.items():
        for each in checkpoints:
            success = 100 * each["figures"]["success"]
            typer.echo(f"{tier} {each['file']}: {success:.1f} % at {each['frames']:,} joint steps")


def _changes(
    config: str | None, settings: list[str] | None, **options: float | str | None
) -> dict[str, str]:
    """Merges the settings of a file, of options and of `--set`; later ones win."""
    from swarmdata.evaluation.runs.train import read_settings

    whole = {k: round(v) if isinstance(v, float) else v for k, v in options.items()}
    changes = {name: str(value) for name, value in whole.items() if value is not None}
    return (read_settings(config) if config else {}) | changes | parse_settings(settings)


def algorithms() -> None:
    """List the algorithms, offline and online."""
    from swarmdata.registry.components import OFFLINE_ALGORITHMS, ONLINE_ALGORITHMS
    from swarmdata.runtime.own_components import summary_of

    tables = (("offline", OFFLINE_ALGORITHMS), ("online", ONLINE_ALGORITHMS))
    for where, table in tables:
        for name in table:
            typer.echo(f"{name:12} {where:8} {summary_of(table[name])}")


def learning(
    runs: Annotated[
        list[Path], typer.Argument(metavar="RUN...", help="online runs, one per algorithm and task")
    ],
    out: Annotated[Path, typer.Option(help="folder for curves, table and figure")],
) -> None:
    """Report the results and the cost of online training."""
    from swarmdata.runtime.extras import require_extra

    require_extra("torch", "torch", "reading online runs")
    from swarmdata.evaluation.results.online_report import write_online_report

    typer.echo(write_online_report(runs, out), nl=False)


def export_policy(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="folder of a training run")],
    out: Annotated[Path, typer.Argument(metavar="FILE", help="to write, such as policy.onnx")],
    seed: Annotated[int, typer.Option(min=0, help="seed of the training")] = 0,
) -> None:
    """Export a policy as ONNX, for robots.

    The file has the frame, the normalization and the network of one robot, and says which features
    it observes. It runs without swarmdata or torch.
    """
    from swarmdata.interop.exported_policies import export_policy as export

    typer.echo(export(str(run), out, seed))
