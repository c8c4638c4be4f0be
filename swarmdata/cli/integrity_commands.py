"""`swarmdata verify | audit`: whether files are whole, and whether data match their metadata."""

from pathlib import Path
from typing import Annotated

import typer

from swarmdata.cli.option_use import refuse
from swarmdata.cli.shared_options import IdOrPath, Workers


def verify(
    context: typer.Context,
    dataset: IdOrPath,
    repair: Annotated[
        bool, typer.Option("--repair", help="fetch or rebuild the broken files, and no others")
    ] = False,
    replay: Annotated[
        int,
        typer.Option(
            min=0, metavar="N", help="also simulate N episodes again and compare every bit"
        ),
    ] = 0,
    workers: Workers = None,
) -> None:
    """Compare every byte with the published digest.

    Reports every file that differs from the manifest, with its first bad chunk and rows. The exit
    code is 1 if any file is broken, or if the dataset is not the published one.
    """
    if not repair:
        refuse(context, ("workers",), "without --repair")
    from swarmdata.hub.catalog import repair as repairs
    from swarmdata.hub.catalog.catalog import find_folder
    from swarmdata.hub.catalog.request import is_offline
    from swarmdata.hub.remotes.addresses import configured_remotes

    folder = find_folder(dataset)
    damage = repairs.examine(folder)
    for each in damage:
        typer.echo(f"{folder / each.file}: {each.problem}", err=True)
    if damage and not repair:
        typer.echo(
            f"{len(damage)} broken files; `swarmdata verify {dataset} --repair` replaces them",
            err=True,
        )
        raise typer.Exit(1)
    if damage:
        remotes = () if is_offline() else configured_remotes()
        for fixed in repairs.repair(folder, remotes=remotes, workers=workers):
            typer.echo(f"{folder / fixed.file}: {fixed.how}")
    _compare(folder)
    if replay:
        _replay(folder, replay)


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
    """Simulates episodes again; exit code 1 if a bit differs, or if some cannot be compared."""
    from swarmdata.audit import audit as audit_dataset

    found = audit_dataset(folder, sample=n_episodes, only=("replay",)).findings
    for each in found:
        typer.echo(str(each), err=True)
    if found:
        raise typer.Exit(1)
    typer.echo(f"simulated {n_episodes} episodes again: all bits are equal")


def audit(
    dataset: Annotated[
        str,
        typer.Argument(
            metavar="ID_OR_PATH", help="id of a dataset in the cache, or a dataset's folder"
        ),
    ],
    sample: Annotated[int, typer.Option(min=0, help="number of episodes to replay; 0: none")] = 64,
    as_json: Annotated[bool, typer.Option("--json", help="print the report as JSON")] = False,
) -> None:
    """Check a dataset against its metadata and replay a sample.

    The exit code is 0 without problems, 1 with problems, and 2 if the dataset cannot be read.
    """
    from swarmdata.audit import audit as audit_dataset
    from swarmdata.errors import DatasetError, UnknownNameError

    try:
        found = audit_dataset(_folder(dataset), sample=sample)
    except (DatasetError, UnknownNameError) as error:
        typer.echo(f"{type(error).__name__}: {error}", err=True)
        raise typer.Exit(2) from None
    typer.echo(found.to_json() if as_json else found.to_text().rstrip("\n"))
    if found.problems:
        raise typer.Exit(1)


def _folder(dataset: str) -> Path:
    """Returns the path, or the folder of an id in the cache; builds and fetches nothing."""
    from swarmdata.errors import DatasetNotFoundError
    from swarmdata.hub.catalog.catalog import find_folder

    folder = find_folder(dataset)
    if not folder.is_dir():
        raise DatasetNotFoundError(
            f"{folder.name} is not in the cache, expected at {folder}. "
            f"Get it with: swarmdata generate {folder.name}"
        )
    return folder
