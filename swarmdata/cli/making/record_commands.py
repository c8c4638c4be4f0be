"""`swarmdata record ...`: inspects and recovers unfinished recordings."""

from pathlib import Path
from typing import Annotated

import typer

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
