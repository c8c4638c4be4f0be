"""`swarmdata push`, `swarmdata pull` and `swarmdata remote ...`: datasets on remote hubs."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from swarmdata.cli.shared_options import IdOrPath

RemoteAddress = Annotated[
    str,
    typer.Argument(
        metavar="ADDRESS", help="remote, such as hf://org, s3://bucket/prefix or file:///x"
    ),
]

remote_app = typer.Typer(
    no_args_is_help=True, rich_markup_mode=None, help="Show and configure the remotes of datasets."
)


def push(dataset: IdOrPath, address: RemoteAddress) -> None:
    """Publish a dataset on a remote, after all checks.

    The upload is atomic: other users see the whole dataset or nothing of it.
    """
    from swarmdata.hub.catalog.catalog import find_folder
    from swarmdata.hub.catalog.repair import find_blockers
    from swarmdata.hub.publishing.metadata.hub_files import write_beside
    from swarmdata.hub.remotes.addresses import open_remote
    from swarmdata.hub.remotes.release_files import push as push_to

    remote, folder = open_remote(address), find_folder(dataset)
    release = push_to(folder, remote, find_blockers, write_beside)
    typer.echo(f"{release.id} is published at {release.address}")


def pull(
    dataset: Annotated[
        str,
        typer.Argument(
            metavar="ID_OR_ADDRESS",
            help="dataset id, or an address such as hf://org/coop_nav-medium",
        ),
    ],
    origin: Annotated[
        str | None,
        typer.Option(
            "--from", metavar="ADDRESS", help="remote to fetch from; default: the configured ones"
        ),
    ] = None,
    out: Annotated[Path | None, typer.Option(help="folder to write; default: in the cache")] = None,
) -> None:
    """Fetch a dataset and verify it.

    An interrupted download resumes: run the same command again.
    """
    from swarmdata.hub.catalog.identity import judge
    from swarmdata.hub.catalog.sources import obtain_release
    from swarmdata.hub.remotes.addresses import configured_remotes
    from swarmdata.hub.remotes.release_lookup import find_release, locate
    from swarmdata.runtime.cache_folder import cache_folder
    from swarmdata.runtime.outside_names import is_address
    from swarmdata.store import read_manifest

    if is_address(dataset) and origin is not None:
        raise typer.BadParameter("an address already names the remote", param_hint="--from")
    if is_address(dataset) and out is None:
        _pull_address(dataset)
        return
    if is_address(dataset):
        remote, release = locate(dataset)
    else:
        remotes = (origin,) if origin is not None else configured_remotes()
        remote, release = find_release(
            _versioned(dataset, remotes), remotes, lambda problem: typer.echo(problem, err=True)
        )
    folder = obtain_release(remote, release, out or cache_folder() / "datasets" / release.id)
    manifest = read_manifest(folder)
    typer.echo(f"{folder}\nfrom {release.address}, digest {manifest.digest}")
    typer.echo(judge(manifest).sentence)


def _pull_address(address: str) -> None:
    """Fetches into the folder where `load` of the same address looks."""
    from swarmdata.hub.catalog.request import request_of_address
    from swarmdata.hub.catalog.sources import Remotes, obtain

    found = obtain(request_of_address(address), Remotes())
    typer.echo(f"{found.folder}\nfrom {found.source}")


@remote_app.command("list")
def list_command(
    address: Annotated[
        str | None,
        typer.Argument(metavar="[ADDRESS]", help="list the datasets on this remote instead"),
    ] = None,
) -> None:
    """List the remotes in search order, or the datasets on one."""
    from swarmdata.hub.remotes.addresses import configured_remotes, open_remote

    if address is not None:
        for dataset_id in open_remote(address).ids():
            typer.echo(dataset_id)
        return
    for each in configured_remotes():
        typer.echo(each)


@remote_app.command()
def add(
    address: RemoteAddress,
    first: Annotated[bool, typer.Option("--first", help="search it before the others")] = False,
) -> None:
    """Add a remote to the end of the search order."""
    from swarmdata.hub.remotes.addresses import open_remote, store_remotes

    added = open_remote(address).address

    def put(configured: tuple[str, ...]) -> tuple[str, ...]:
        others = tuple(each for each in configured if each != added)
        return (added, *others) if first else (*others, added)

    path = store_remotes(put)
    typer.echo(f"added {added} to {path}")
    _warn_if_overridden()


@remote_app.command()
def remove(address: RemoteAddress) -> None:
    """Remove a remote from the search order."""
    from swarmdata.errors import UnknownNameError
    from swarmdata.hub.remotes.addresses import parse_address, store_remotes

    removed = str(parse_address(address))

    def without(configured: tuple[str, ...]) -> tuple[str, ...]:
        if removed not in configured:
            raise UnknownNameError("remote", removed, configured)
        return tuple(each for each in configured if each != removed)

    path = store_remotes(without)
    typer.echo(f"removed {removed} from {path}")
    _warn_if_overridden()


def _warn_if_overridden() -> None:
    import os

    if "SWARMDATA_REMOTES" in os.environ:
        typer.echo("SWARMDATA_REMOTES is set, so this file is not used.", err=True)


def _versioned(dataset: str, remotes: Sequence[str]) -> str:
    """Adds the newest version to an id without one: the package's, else that on the remotes."""
    from swarmdata.hub.catalog.sources import Remotes
    from swarmdata.registry.recipes import find_recipe, is_dataset, shipped_recipes
    from swarmdata.runtime.outside_names import is_id, split_id

    if is_dataset(dataset):
        return find_recipe(dataset).id
    if not is_id(dataset) and is_id(f"{dataset}-v0") and (id_ := Remotes(remotes).newest(dataset)):
        return id_
    split_id(dataset, shipped_recipes())
    return dataset
