"""`swarmdata train | train-online | tune | algorithms | ship | export-policy`: runs, policies."""

from pathlib import Path
from typing import Annotated, Any

import typer

from swarmdata.cli.option_use import refuse, refuse_workers
from swarmdata.cli.shared_options import (
    Communication,
    Engine,
    Observation,
    Part,
    Processes,
    Randomize,
    Settings,
    Threads,
    parse_part,
    parse_ranges,
    parse_settings,
)


def _algorithm(known: str, other: str, use: str, also: str = "") -> Any:
    """An argument for the algorithms of a table, which names the command for those of the other."""

    def check(name: str) -> str:
        from swarmdata.registry import components

        if name not in getattr(components, known) and name in getattr(components, other):
            raise typer.BadParameter(f"{name} is trained with: swarmdata {use.format(name)}")
        return name

    return typer.Argument(
        metavar="ALGORITHM", callback=check, help=f"as `swarmdata algorithms` lists them{also}"
    )


OFFLINE = ("OFFLINE_ALGORITHMS", "ONLINE_ALGORITHMS", "train-online {} TASK")
Out = Annotated[
    Path | None, typer.Option(help="run folder", show_default="runs/ALGORITHM-DATA or -TASK")
]
Seeds = Annotated[int, typer.Option(min=1, help="number of seeds")]
Config = Annotated[
    str | None, typer.Option(help="settings: a YAML file; online also a shipped one")
]


def train(
    context: typer.Context,
    algorithm: Annotated[str, _algorithm(*OFFLINE, also=", or auto")],
    data: Annotated[
        str, typer.Argument(metavar="ID", help="dataset id or folder; ID=0.8,ID=0.2 mixes")
    ],
    out: Out = None,
    seeds: Seeds = 5,
    updates: Annotated[int | None, typer.Option(min=1, help="number of gradient updates")] = None,
    regulariser: Annotated[
        str | None, typer.Option(help="of vdn and qmix: none, bc, bcq or cql")
    ] = None,
    config: Config = None,
    settings: Settings = None,
    curve_every: Annotated[int, typer.Option(min=1, help="updates between evaluations")] = 1000,
    keep: Annotated[bool, typer.Option(help="keep all checkpoints, for `rank`")] = False,
    observation: Observation = None,
    communication: Communication = None,
    reward: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=WEIGHT",
            help="weight of a reward, may be repeated; or safe, team, or module:function",
        ),
    ] = None,
    side: Annotated[
        str | None, typer.Option(help="the side to learn for, in a task of several")
    ] = None,
    frame: Annotated[str, typer.Option(help="robots' frame: auto, world, or an anchor")] = "auto",
    workers: Processes = 1,
    engine: Engine = "local",
    part: Part = None,
    device: Annotated[str, typer.Option(help="torch device")] = "cpu",
    compile: Annotated[bool, typer.Option(help="use torch.compile, for long runs")] = False,
) -> None:
    """Train an offline algorithm on a dataset.

    `auto` chooses bc, filtered_bc, iql or maddpg_bc by statistics of the data, and says why. Uses
    the train split; with --observation or --communication, the dataset is re-observed from its
    states, and with --reward, its rewards are computed anew. An interrupted training resumes: run
    the same command again. Several processes train groups of the seeds in folders OUT/seeds-...,
    as --part K/N trains the K-th.
    """
    group = _group(context, engine, part)
    if algorithm == "auto":
        refuse(context, ("config", "regulariser"), "with auto")
    stated = _trainers().read_settings(config) if config else {}
    changes = stated | _changes(settings, n_updates=updates, regulariser=regulariser)
    ids, weights = _datasets(data)
    folder = out or _default_folder(algorithm, ids)
    _trainers().train(
        algorithm, ids, folder, weights=weights, n_seeds=seeds, changes=changes,
        observation=observation, communication=communication, rewards=_rewards(reward),
        side=side, frame=frame, curve_every=curve_every, keep=keep, device=device, compile=compile,
        workers=workers, engine=engine, part=group,
    )  # fmt: skip
    if (measured := _trainers().last_evaluation(folder, ids, weights)) is not None:
        typer.echo(measured)
    typer.echo(folder)


def tune(
    context: typer.Context,
    algorithm: Annotated[str, _algorithm(*OFFLINE)],
    data: Annotated[list[str], typer.Argument(metavar="ID...", help="dataset ids or folders")],
    out: Annotated[
        Path | None, typer.Option(help="folder of the result", show_default="runs/tune-ALGORITHM")
    ] = None,
    trials: Annotated[int, typer.Option(min=2, help="configurations, with the default")] = 12,
    updates: Annotated[int, typer.Option(min=1, help="gradient updates of each training")] = 4500,
    seeds: Annotated[int, typer.Option(min=1, help="number of seeds of each trial")] = 2,
    steps: Annotated[
        int, typer.Option(min=1, help="first joint steps of each dataset to train on")
    ] = 200_000,
    episodes: Annotated[int, typer.Option(min=1, help="validation episodes of a seed")] = 128,
    estimates: Annotated[
        bool, typer.Option(help="choose by offline estimates, too, in about twice the time")
    ] = True,
    config: Config = None,
    settings: Settings = None,
    draws: Annotated[int, typer.Option(min=0, help="seed of the random settings")] = 0,
    frame: Annotated[str, typer.Option(help="robots' frame: auto, world, or an anchor")] = "auto",
    workers: Processes = 1,
    engine: Engine = "local",
    again: Annotated[bool, typer.Option(help="rerun trials of another configuration")] = False,
    device: Annotated[str, typer.Option(help="torch device")] = "cpu",
) -> None:
    """Tune an offline algorithm by random search.

    Every trial has the same updates, seeds and data; the first is the default. One trial is chosen
    by validation episodes, if the data have a simulator, and one by the data alone; `train
    --config` takes OUT/validation.yaml and OUT/offline.yaml. The number of updates in --config is
    not used: it is --updates. An interrupted tuning resumes: run the same command again, also with
    more trials.
    """
    from swarmdata.runtime.extras import require_extra

    refuse_workers(context, engine)
    require_extra("torch", "torch", "tuning")
    from swarmdata.evaluation.tuning.tune import tune as search

    stated = _trainers().read_settings(config) if config else {}
    stated.pop("n_updates", None)
    made = search(
        algorithm, data, out or Path("runs") / f"tune-{algorithm}", n_trials=trials,
        n_updates=updates, n_seeds=seeds, n_steps=steps, n_episodes=episodes, estimates=estimates,
        changes=stated | parse_settings(settings), draws=draws, frame=frame, device=device,
        workers=workers, engine=engine, again=again,
    )  # fmt: skip
    typer.echo(made.to_text(), nl=False)


def train_online(
    context: typer.Context,
    algorithm: Annotated[str, _algorithm("ONLINE_ALGORITHMS", "OFFLINE_ALGORITHMS", "train {} ID")],
    task: Annotated[str, typer.Argument(metavar="TASK", help="preset or spec file")],
    out: Out = None,
    seeds: Seeds = 4,
    first_seed: Annotated[int, typer.Option(min=0, help="first seed")] = 0,
    steps: Annotated[float | None, typer.Option(min=1, help="joint steps of each seed")] = None,
    checkpoints: Annotated[int, typer.Option(min=1, help="evaluations on the way")] = 40,
    start: Annotated[
        Path | None, typer.Option(help="offline run, or zoo:ALGORITHM/DATASET, to begin with")
    ] = None,
    data: Annotated[
        str | None,
        typer.Option(metavar="ID", help="dataset to mix into the batches, as `train` takes it"),
    ] = None,
    offline_share: Annotated[float, typer.Option(help="part of a batch that --data gives")] = 0.5,
    side: Annotated[str | None, typer.Option(help="side to train, in a task of several")] = None,
    opponents: Annotated[
        str | None, typer.Option(help="who plays the other sides: a policy, a tier, or a run")
    ] = None,
    config: Config = None,
    settings: Settings = None,
    observation: Observation = None,
    communication: Communication = None,
    randomize: Randomize = None,
    workers: Processes = 1,
    engine: Engine = "local",
    part: Part = None,
    threads: Threads = 1,
) -> None:
    """Train an online algorithm in a task.

    May begin with the networks of an offline run (--start) and mix recorded data into the batches
    (--data). An interrupted training resumes: run the same command again. Several processes train
    groups of the seeds in folders OUT/seeds-..., as --part K/N trains the K-th.
    """
    group = _group(context, engine, part)
    if data is None:
        refuse(context, ("offline_share",), "without --data")
    stated = _trainers().read_settings(config) if config else {}
    changes = stated | _changes(settings, n_steps=None if steps is None else round(steps))
    ids, weights = (None, None) if data is None else _datasets(data)
    folder = out or _default_folder(algorithm, task)
    _trainers().train_online(
        algorithm, task, folder, seeds=range(first_seed, first_seed + seeds), changes=changes,
        observation=observation, communication=communication,
        randomization=parse_ranges(randomize), start=start, data=ids, weights=weights,
        offline_share=offline_share, side=side, opponents=opponents, workers=workers,
        engine=engine, part=group, n_threads=threads, n_checkpoints=checkpoints,
    )  # fmt: skip
    if (measured := _trainers().last_online_evaluation(folder)) is not None:
        typer.echo(measured)
    typer.echo(folder)


def _group(context: typer.Context, engine: str, part: str | None) -> tuple[int, int] | None:
    """Reads `--part`, and refuses options of processes that have no effect."""
    refuse_workers(context, engine)
    if part is None:
        return None
    refuse(context, ("workers", "engine"), "with --part")
    return parse_part(part)


def _trainers() -> Any:
    """Returns the module that trains, offline and online, which needs an extra."""
    from swarmdata.runtime.extras import require_extra

    require_extra("torch", "torch", "training")
    from swarmdata.evaluation.runs import train

    return train


def _default_folder(algorithm: str, sources: str | list[str]) -> Path:
    names = [sources] if isinstance(sources, str) else sources
    return Path("runs") / f"{algorithm}-{'+'.join(Path(name).stem for name in names)}"


def _changes(settings: list[str] | None, **options: int | str | None) -> dict[str, str]:
    """Merges the settings of options and of `--set`, which may not say something else."""
    changes = [f"{name}={value}" for name, value in options.items() if value is not None]
    return parse_settings([*changes, *(settings or [])])


def _datasets(text: str) -> tuple[str | list[str], list[float] | None]:
    """Reads an id, or a mixture, `ID,ID,...` or `ID=WEIGHT,ID=WEIGHT,...`: ids and weights."""
    if "," not in text:
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
    """Reads the rewards to learn from: NAME=WEIGHT, ..., or the name of a set or a function."""
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
    from swarmdata.learn.training.run_files import seeds_of
    from swarmdata.online_algos.runs.checkpoint_selection import ship as ship_seeds

    mediums, experts, sided = (seeds_of(runs or []) for runs in (medium, expert, convention))
    entry = ship_seeds(mediums, experts, sided, task, preset(task), out)
    if mediums:
        typer.echo(f"{len(entry['medium'])} of {len(mediums)} seeds have a medium policy")
    for tier, checkpoints in entry.items():
        for each in checkpoints:
            success = 100 * each["figures"]["success"]
            typer.echo(f"{tier} {each['file']}: {success:.1f} % at {each['frames']:,} joint steps")


def algorithms() -> None:
    """List the algorithms, offline and online."""
    from swarmdata.registry.components import OFFLINE_ALGORITHMS, ONLINE_ALGORITHMS
    from swarmdata.runtime.own_components import summary_of

    for where, table in (("offline", OFFLINE_ALGORITHMS), ("online", ONLINE_ALGORITHMS)):
        for name in table:
            typer.echo(f"{name:12} {where:8} {summary_of(table[name])}")


def export_policy(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="folder of a training run")],
    out: Annotated[
        Path, typer.Argument(metavar="FILE", help="to write: policy.onnx, or policy.py")
    ],
    seed: Annotated[
        int | None, typer.Option(min=0, help="seed of the training", show_default="the first")
    ] = None,
) -> None:
    """Export a policy for robots, as ONNX or Python with NumPy.

    The file has the frame, the normalization, the network and the memory of one robot, and says
    which features it observes. It runs without swarmdata or torch.
    """
    from swarmdata.interop.exported_policies import export_policy as export

    typer.echo(export(str(run), out, seed))
