"""`swarmdata import`, `fetch`: datasets of the logs of robots; `record`: unfinished recordings."""

from pathlib import Path
from typing import Annotated

import typer

from swarmdata.cli.option_use import refuse
from swarmdata.cli.shared_options import Notes, parse_settings

Logs = Annotated[
    list[Path],
    typer.Argument(
        metavar="LOG...", help="CSV and Parquet files, ROS 1 and 2 bags, MCAP; folders of files"
    ),
]
Map = Annotated[
    Path,
    typer.Option(
        "--map",
        metavar="FILE",
        help="YAML file that says which columns and topics are poses, commands and observations; "
        "the name of one that the package has, such as mrclam; or the recipe.json of an imported "
        "dataset, to make it again",
    ),
]
NewId = Annotated[
    str | None,
    typer.Option("--id", metavar="ID", help="of the new dataset, such as hall-monday-v0"),
]
TaskOption = Annotated[
    str | None,
    typer.Option(
        "--task",
        metavar="FILE",
        help="a spec of coop_nav, or the name of a preset, that observes and scores the logged "
        "poses; default: none, and rewards are those of the map",
    ),
]
Out = Annotated[Path | None, typer.Option(help="folder of the dataset; default: in the cache")]
Seed = Annotated[int, typer.Option(min=0, help="seed of the splits")]


def import_command(
    context: typer.Context,
    logs: Logs,
    log_map: Map,
    id_: NewId = None,
    task: TaskOption = None,
    out: Out = None,
    seed: Seed = 0,
    note: Notes = None,
) -> None:
    """Make a dataset of the logs of robots.

    Nothing is invented: gaps are masked, and columns that the map does not name are refused.
    """
    from swarmdata.interop.logs import import_logs, remake_logs
    from swarmdata.interop.logs.map_files import read_map
    from swarmdata.specs.origins.log_origin import ImportedLogs
    from swarmdata.store.cache import cache_folder

    found = read_map(log_map)
    if isinstance(found, ImportedLogs):
        refuse(context, ("id_", "task", "seed", "note"), f"with {log_map}, which has decided it")
    elif id_ is None:
        raise typer.BadParameter("required with a map", param_hint="--id")
    name = found.id if isinstance(found, ImportedLogs) else str(id_)
    folder = out or cache_folder() / "datasets" / name
    if isinstance(found, ImportedLogs):
        made = remake_logs(logs, folder, found)
    else:
        notes = parse_settings(note, "--note")
        made = import_logs(
            logs, folder, log_map=found, id=name, task=task, seed=seed, metadata=notes
        )
    counts = f"{len(made):,} episodes, {made.n_steps:,} joint steps"
    typer.echo(f"{made.path}\n{counts}, digest {made.digest}")


def fetch(
    context: typer.Context,
    name: Annotated[
        str | None, typer.Argument(metavar="[NAME]", help="public logs; default: list them")
    ] = None,
    accept_terms: Annotated[
        bool, typer.Option("--accept-terms", help="you accept the terms, which are printed")
    ] = False,
    source: Annotated[
        Path | None,
        typer.Option("--from", metavar="FOLDER", help="where you have downloaded the files"),
    ] = None,
    out: Out = None,
) -> None:
    """Fetch public logs of robots and make their dataset.

    Prints source, licence, citation and size. The files are fetched from where they were published,
    checked, imported with a map of the package, and audited; the dataset has a known digest.
    """
    from swarmdata.interop.logs.public_logs import fetch_logs, find_public_logs, public_logs

    if name is None:
        refuse(context, ("accept_terms", "source", "out"), "without a name")
        for each, logs in public_logs().items():
            typer.echo(f"{each}: {logs.title}, {logs.size:,} bytes, licence {logs.license}")
        return
    logs = find_public_logs(name)
    if accept_terms:
        typer.echo(logs.terms)
    made = fetch_logs(name, out, accept_terms=accept_terms, source=source)
    counts = f"{len(made):,} episodes, {made.n_steps:,} joint steps"
    typer.echo(f"{made.path}\n{counts}, digest {made.digest}, as published; the audit is clean")


record_app = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode=None,
    help="Inspect and recover unfinished recordings.",
)

Recorded = Annotated[
    Path,
    typer.Argument(metavar="PATH", help="folder of the future dataset, or its .recording folder"),
]


@record_app.command()
def recover(path: Recorded) -> None:
    """Make a dataset of the finished episodes of a recording."""
    from swarmdata.record import recover as finish

    dataset = finish(path)
    typer.echo(
        f"{dataset.path}\n{dataset.n_episodes:,} episodes, {dataset.n_steps:,} joint steps, "
        f"digest {dataset.digest}"
    )


@record_app.command()
def show(path: Recorded) -> None:
    """Show the contents of an unfinished recording.

    The recording may still be running.
    """
    from swarmdata.record.recording_folder import inspect_recording

    found = inspect_recording(path)
    recording = found.session.recording
    typer.echo(f"id: {recording.id}")
    typer.echo(f"environment: {recording.spec.task}")
    for label, count, steps in found.policies:
        typer.echo(f"policy {label}: {count:,} episodes, {steps:,} joint steps")
