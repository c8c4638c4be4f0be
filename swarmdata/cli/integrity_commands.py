"""`swarmdata verify`: reads every byte of a dataset, names broken files, and repairs them."""

from pathlib import Path
from typing import Annotated

import typer

from swarmdata.cli.option_use import refuse
from swarmdata.cli.shared_options import IdOrPath, Workers

Replace = Annotated[
    bool, typer.Option("--repair", help="fetch or rebuild the broken files, and no others")
]
Replay = Annotated[
    int,
    typer.Option(min=0, metavar="N", help="also simulate N episodes again and compare every bit"),
]


def verify(
    context: typer.Context,
    dataset: IdOrPath,
    repair: Replace = False,
    replay: Replay = 0,
    workers: Workers = None,
) -> None:
    """Compare every byte with the manifest and the published digest.

    Reports every broken file with its first bad chunk and rows. The exit code is 1 if any file is
    broken, or if the dataset is not the published one.
    """
    if not repair:
        refuse(context, ("workers",), "without --repair")
    from swarmdata.hub.catalog.catalog import find_folder
    from swarmdata.hub.catalog.repair import examine

    folder = find_folder(dataset)
    damage = examine(folder)
    for each in damage:
        typer.echo(f"{folder / each.file}: {each.problem}", err=True)
    if damage and not repair:
        typer.echo(
            f"{len(damage)} broken files; `swarmdata verify {dataset} --repair` replaces them",
            err=True,
        )
        raise typer.Exit(1)
    if damage:
        _repair(folder, workers)
    _compare(folder)
    if replay:
        _replay(folder, replay)


def _repair(folder: Path, workers: int | None) -> None:
    from swarmdata.hub.catalog.repair import repair
    from swarmdata.hub.catalog.request import is_offline
    from swarmdata.hub.remotes.addresses import configured_remotes

    remotes = () if is_offline() else configured_remotes()
    for each in repair(folder, remotes=remotes, workers=workers):
        typer.echo(f"{folder / each.file}: {each.how}")


def _compare(folder: Path) -> None:
    """Prints which dataset an undamaged folder holds; exit code 1 if its id names another one."""
    from swarmdata.hub.catalog.identity import judge, misnamed
    from swarmdata.store import read_manifest

    manifest = read_manifest(folder)
    typer.echo(f"{folder}: all files match the manifest, digest {manifest.digest}")
    if (sentence := misnamed(folder, manifest)) is not None:
        typer.echo(f"{sentence}.", err=True)
    identity = judge(manifest)
    typer.echo(identity.sentence, err=not identity.is_as_named)
    if not identity.is_as_named:
        raise typer.Exit(1)


def _replay(folder: Path, n_episodes: int) -> None:
    """Simulates episodes again; exit code 1 if a bit differs."""
    from swarmdata.audit.resimulation import replay
    from swarmdata.datasets.dataset import Dataset

    drifts = replay(Dataset.open(folder), n_episodes)
    for each in drifts:
        typer.echo(str(each), err=True)
    if drifts:
        raise typer.Exit(1)
    typer.echo(f"simulated {n_episodes} episodes again: all bits are equal")
