"""`swarmdata verify`: every byte read again, every broken file named, and repaired if wanted."""

from pathlib import Path
from typing import Annotated

import typer

IdOrPath = Annotated[str, typer.Argument(metavar="ID_OR_PATH", help="an id, or a dataset's folder")]
Replace = Annotated[
    bool, typer.Option("--repair", help="fetch or make again what is broken, and only that")
]
Replay = Annotated[
    int, typer.Option(min=0, metavar="N", help="simulate N episodes again and compare every bit")
]
Workers = Annotated[int | None, typer.Option(min=1, help="processes; default one per core")]


def verify(
    dataset: IdOrPath, repair: Replace = False, replay: Replay = 0, workers: Workers = None
) -> None:
    """Read every byte again and compare it with the manifest and the published digest.

    Every broken file is named, with its first bad chunk and rows; exit code 1 if there is any.
    """
    from swarmdata.hub.catalog.catalog import find_folder
    from swarmdata.hub.catalog.repair import examine

    folder = find_folder(dataset)
    damage = examine(folder)
    for each in damage:
        typer.echo(f"{folder / each.file}: {each.problem}", err=True)
    if damage and not repair:
        typer.echo(
            f"{len(damage)} broken; run `swarmdata verify {dataset} --repair` to replace what is",
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
    """Says what a sound dataset is; exit code 1 if it is not what its id says."""
    from swarmdata.hub.catalog.identity import identify
    from swarmdata.store import read_manifest

    manifest = read_manifest(folder)
    typer.echo(f"{folder}: every file is as it was written, digest {manifest.digest}")
    identity = identify(folder, ())
    typer.echo(identity.sentence, err=not identity.is_as_named)
    if not identity.is_as_named:
        raise typer.Exit(1)


def _replay(folder: Path, n_episodes: int) -> None:
    """Simulates some episodes again."""
    from swarmdata.audit.resimulation import replay
    from swarmdata.datasets.dataset import Dataset

    drifts = replay(Dataset.open(folder), n_episodes)
    for each in drifts:
        typer.echo(str(each), err=True)
    if drifts:
        raise typer.Exit(1)
    typer.echo(f"simulated again, {n_episodes} episodes have the same bits")
