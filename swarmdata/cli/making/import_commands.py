"""`swarmdata import`, `fetch`, `fit`: logs of robots; `record`: unfinished recordings."""

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from swarmdata.cli.option_use import refuse
from swarmdata.cli.shared_options import IdOrPath, Notes, parse_settings, summary_of

if TYPE_CHECKING:
    from swarmdata.datasets.dataset import Dataset

Out = Annotated[Path | None, typer.Option(help="folder of the dataset; default: in the cache")]


def import_command(
    context: typer.Context,
    logs: Annotated[
        list[Path],
        typer.Argument(
            metavar="LOG...", help="CSV and Parquet files, ROS 1 and 2 bags, MCAP; folders of files"
        ),
    ],
    log_map: Annotated[
        Path,
        typer.Option(
            "--map",
            metavar="FILE",
            help="YAML file that says which columns and topics are poses, commands and "
            "observations; the name of one that the package has, such as mrclam; or the "
            "recipe.json of an imported dataset, to make it again",
        ),
    ],
    id_: Annotated[
        str | None,
        typer.Option("--id", metavar="ID", help="of the new dataset, such as hall-monday-v0"),
    ] = None,
    task: Annotated[
        str | None,
        typer.Option(
            "--task",
            metavar="FILE",
            help="a spec of coop_nav, or the name of a preset, that observes and scores the logged "
            "poses; default: none, and rewards are those of the map",
        ),
    ] = None,
    out: Out = None,
    seed: Annotated[int, typer.Option(min=0, help="seed of the splits")] = 0,
    note: Notes = None,
) -> None:
    """Make a dataset of the logs of robots.

    Nothing is invented: gaps are masked, and columns that the map does not name are refused.
    """
    from swarmdata.interop.logs.import_logs import import_logs, read_map, remake_logs
    from swarmdata.registry.recipes import check_own_id
    from swarmdata.runtime.cache_folder import cache_folder
    from swarmdata.specs.origins.log_origin import ImportedLogs

    found, place = read_map(log_map), cache_folder() / "datasets"
    if isinstance(found, ImportedLogs):
        refuse(context, ("id_", "task", "seed", "note"), f"with {log_map}, which has decided it")
        made = remake_logs(logs, out or place / found.id, found)
    elif id_ is None:
        raise typer.BadParameter("required with a map", param_hint="--id")
    else:
        if out is None:  # where `load` finds it by its id
            check_own_id(id_)
        notes = parse_settings(note, "--note")
        made = import_logs(
            logs, out or place / id_, log_map=found, id=id_, task=task, seed=seed, metadata=notes
        )
    _print_made(made)


LEFT_OUT = {
    "steps_between_episodes": "they are between episodes (`length`, `goal_change`, marker, gap)",
    "steps_of_short_episodes": "their episodes are too short (`min_steps`)",
    "first_poses": "the first pose of an episode only gives the velocity of the next",
    "steps_after_the_end": "the task had ended before",
}
"""Why an import leaves out steps of the logs, by the name of their number on the card."""


def _print_made(made: "Dataset") -> None:
    """Prints a new dataset, with what is absent or left out, and whether a split is."""
    from swarmdata.store.split_rule import empty_validation

    notes = made.recipe.metadata or {}
    typer.echo(summary_of(made))
    if n_steps := notes.get("absent_robot_steps"):
        typer.echo(
            f"Robots are absent in {n_steps} steps: their pose or command is unknown (`max_gap`)."
        )
    for name, why in LEFT_OUT.items():
        if n_steps := notes.get(name):
            typer.echo(f"{n_steps} steps are left out: {why}.")
    if not len(made.split("validation")):
        typer.echo(f"Note that {empty_validation(len(made))}")


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
    typer.echo(f"{summary_of(made)}, as published; the audit is clean")


def fit(
    dataset: IdOrPath,
    out: Annotated[Path | None, typer.Option(help="YAML file of the twin's spec")] = None,
    test: Annotated[
        list[str] | None,
        typer.Option(
            metavar="ID_OR_PATH",
            help="dataset of the same robots to check the twin with; may be repeated; default: "
            "the validation and test splits",
        ),
    ] = None,
    radius: Annotated[
        float | None, typer.Option(help="of the robots, m, which logs do not tell")
    ] = None,
    drift: Annotated[
        bool, typer.Option("--drift", help="robots of the twin know their pose by odometry alone")
    ] = False,
) -> None:
    """Fit a simulated twin to logged robots.

    Estimates how robots answer commands from the training split of imported logs, and predicts
    other drives with it. The twin is a task spec that every command takes.
    """
    from swarmdata.errors import OutputError
    from swarmdata.hub.catalog.catalog import load
    from swarmdata.interop.logs.fitted_twin import describe, fit_twin
    from swarmdata.runtime.atomic import write_file

    if out is not None and os.path.lexists(out):
        raise OutputError(f"{out} exists. Name a new file, or move it away.")
    data = load(dataset)
    held_out = [load(each) for each in test or ()]
    if not held_out:
        held_out = [part for part in (data.split("validation"), data.split("test")) if len(part)]
    twin = fit_twin(data, radius=radius, drift=drift)
    typer.echo(describe(twin, twin.check(*held_out) if held_out else {}))
    if out is not None:
        write_file(out, twin.to_yaml().encode())
        typer.echo(out)


record_app = typer.Typer(
    no_args_is_help=True, rich_markup_mode=None, help="Inspect and recover unfinished recordings."
)

Recorded = Annotated[
    Path,
    typer.Argument(metavar="PATH", help="folder of the future dataset, or its .recording folder"),
]


@record_app.command()
def recover(path: Recorded) -> None:
    """Make a dataset of the finished episodes of a recording."""
    from swarmdata.record import recover as finish

    _print_made(finish(path))


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
