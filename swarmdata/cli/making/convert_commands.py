"""`swarmdata convert`: datasets to and from other formats."""

from pathlib import Path
from typing import Annotated

import typer

from swarmdata.cli.option_use import refuse, refuse_all_but
from swarmdata.cli.shared_options import Notes, parse_settings

EXPORT_OPTIONS = ("to", "split", "policy", "frame")
"""Options of `convert --to`; `--from` has the others."""


def convert(
    context: typer.Context,
    source: Annotated[
        str,
        typer.Argument(
            metavar="SRC", help="with --to: dataset id or folder; with --from: data in that format"
        ),
    ],
    target: Annotated[Path, typer.Argument(metavar="DST", help="file or folder to write")],
    to: Annotated[
        str | None,
        typer.Option(
            "--to",
            metavar="FORMAT",
            help="export: d4rl, d4rl-agents, lerobot, mcap, minari, numpy, parquet, rosbag2, "
            "torchrl, vault",
        ),
    ] = None,
    from_: Annotated[
        str | None,
        typer.Option(
            "--from", metavar="FORMAT", help="import: d4rl, minari, numpy, parquet, torchrl, vault"
        ),
    ] = None,
    split: Annotated[
        str | None, typer.Option(help="with --to: one split: train, validation or test")
    ] = None,
    policy: Annotated[
        str | None, typer.Option(help="with --to: only episodes of this policy")
    ] = None,
    frame: Annotated[
        str,
        typer.Option(
            help="with --to: frame of observations and actions: world, as they were recorded, "
            "target, as algorithms see them, or another anchor"
        ),
    ] = "world",
    id_: Annotated[
        str | None,
        typer.Option(
            "--id",
            metavar="ID",
            help="with --from: id of the new dataset, such as spread-omar_medium-v0",
        ),
    ] = None,
    time_limit: Annotated[
        int | None,
        typer.Option(help="with --from: length at which episodes are truncated; 0: no limit"),
    ] = None,
    episode_length: Annotated[
        int | None,
        typer.Option(help="with --from: length of all episodes, if no ends are marked"),
    ] = None,
    final: Annotated[
        str | None,
        typer.Option(
            help="with --from: for missing last observations: repeat the previous one, or cut the "
            "step"
        ),
    ] = None,
    unfinished: Annotated[
        str | None,
        typer.Option(help="with --from: for an unfinished last episode: truncate or drop"),
    ] = None,
    agents: Annotated[
        str | None,
        typer.Option(help="with --from: number of agents, or their names separated by commas"),
    ] = None,
    action_bounds: Annotated[
        str | None,
        typer.Option(metavar="LOW,HIGH", help="with --from: bounds of continuous actions"),
    ] = None,
    new_splits: Annotated[
        bool, typer.Option(help="with --from: draw new splits instead of keeping the source's")
    ] = False,
    note: Notes = None,
) -> None:
    """Convert a dataset to another format, or from one.

    Information that a file lacks, such as which episodes a time limit truncated, is never guessed:
    an error names the option that provides it.
    """
    if (to is None) == (from_ is None):
        raise typer.BadParameter("pass either --to FORMAT or --from FORMAT")
    if to is not None:
        refuse_all_but(context, EXPORT_OPTIONS, "with --to")
        typer.echo(_export(source, target, to, split, policy, frame))
        return
    refuse(context, EXPORT_OPTIONS, "with --from")
    low, high = _bounds(action_bounds)
    if id_ is None:
        raise typer.BadParameter("required with --from", param_hint="--id")
    from swarmdata.interop.convert import import_dataset

    made = import_dataset(
        source, target, format=str(from_), id=id_,
        splits="new" if new_splits else "kept", metadata=parse_settings(note, "--note"),
        time_limit=time_limit, episode_length=episode_length, final=final, unfinished=unfinished,
        agents=agents, action_low=low, action_high=high,
    )  # fmt: skip
    typer.echo(f"{made.path}\n{made.n_steps:,} joint steps, digest {made.digest}")


def _export(
    source: str, target: Path, to: str, split: str | None, policy: str | None, frame: str
) -> Path:
    from swarmdata.datasets.dataset import Dataset
    from swarmdata.hub.catalog.catalog import load
    from swarmdata.interop.conversion.user_choices import absolute_path
    from swarmdata.interop.export import export_dataset
    from swarmdata.runtime.outside_names import is_folder

    folder = absolute_path(source)
    dataset = Dataset.open(folder) if is_folder(folder) else load(source)
    view = dataset.filter(split=split, policy=policy)
    return export_dataset(view, target, format=to, frame=frame)


def _bounds(text: str | None) -> tuple[float | None, float | None]:
    if text is None:
        return None, None
    try:
        low, high = map(float, text.split(","))
    except ValueError as error:
        raise typer.BadParameter(
            f"got {text!r}, expected two numbers such as -1,1", param_hint="--action-bounds"
        ) from error
    return low, high
