"""`swarmdata push`, `swarmdata pull` and `swarmdata remote ...`: datasets to and from hubs."""

from pathlib import Path
from typing import Annotated

import typer

RemoteAddress = Annotated[
    str, typer.Argument(metavar="ADDRESS", help="such as hf://org, s3://bucket/prefix, file:///x")
]

remote_app = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode=None,
    help="Show and choose the remotes that datasets are looked for in.",
)


def push(
    dataset: Annotated[str, typer.Argument(metavar="ID_OR_PATH", help="an id, or a folder")],
    address: RemoteAddress,
) -> None:
    """Publish a dataset: all of it or nothing, and only if nothing speaks against it."""
    from swarmdata.hub.publishing.blockers import find_blockers
    from swarmdata.hub.publishing.metadata import write_beside
    from swarmdata.hub.remotes import open_remote
    from swarmdata.hub.remotes import push as push_to

    remote, folder = open_remote(address), _folder(dataset)
    release = push_to(folder, remote, lambda each: find_blockers(each, remote), write_beside)
    typer.echo(f"{release.id} is published at {release.address}")


def pull(
    dataset: Annotated[
        str,
        typer.Argument(metavar="ID_OR_ADDRESS", help="an id, or such as hf://org/coop_nav-medium"),
    ],
    origin: Annotated[
        str | None,
        typer.Option("--from", metavar="ADDRESS", help="a remote; default the configured ones"),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="the dataset's folder; default the cache")
    ] = None,
) -> None:
    """Fetch a dataset, checked on the way in; run again after any interruption to go on."""
    from swarmdata.hub.catalog.identity import judge
    from swarmdata.hub.catalog.sources import obtain_release
    from swarmdata.hub.remotes import configured_remotes, find_release, locate
    from swarmdata.hub.remotes.addresses import is_address
    from swarmdata.store import read_manifest

    if is_address(dataset) and origin is not None:
        raise typer.BadParameter("an address says where from itself", param_hint="--from")
    if is_address(dataset) and out is None:
        _pull_address(dataset)
        return
    if is_address(dataset):
        remote, release = locate(dataset)
    else:
        remotes = (origin,) if origin is not None else configured_remotes()
        remote, release = find_release(
            _versioned(dataset), remotes, lambda problem: typer.echo(problem, err=True)
        )
    folder = obtain_release(remote, release, out or _cached(release.id))
    manifest = read_manifest(folder)
    typer.echo(f"{folder}\nfrom {release.address}, digest {manifest.digest}")
    typer.echo(judge(manifest).sentence)


def _pull_address(address: str) -> None:
    """Fetches to where `load` of the same address looks for it."""
    from swarmdata.hub.catalog.request import request_of_address
    from swarmdata.hub.catalog.sources import Remotes, obtain

    found = obtain(request_of_address(address), Remotes())
    typer.echo(f"{found.folder}\nfrom {found.source}")


@remote_app.command("list")
def list_command(
    address: Annotated[
        str | None, typer.Argument(metavar="[ADDRESS]", help="show the datasets there instead")
    ] = None,
) -> None:
    """Show the remotes in the order in which they are asked, or the datasets of one."""
    from swarmdata.hub.remotes import configured_remotes, open_remote

    if address is not None:
        for dataset_id in open_remote(address).ids():
            typer.echo(dataset_id)
        return
    for each in configured_remotes():
        typer.echo(each)


@remote_app.command()
def add(
    address: RemoteAddress,
    first: Annotated[bool, typer.Option("--first", help="ask it before the others")] = False,
) -> None:
    """Ask this remote for datasets from now on, after those that are configured already."""
    from swarmdata.hub.remotes import open_remote
    from swarmdata.hub.remotes.addresses import store_remotes

    added = open_remote(address).address

    def put(there: tuple[str, ...]) -> tuple[str, ...]:
        others = tuple(each for each in there if each != added)
        return (added, *others) if first else (*others, added)

    path = store_remotes(put)
    typer.echo(f"{added} is in {path}")
    _say_if_overridden()


@remote_app.command()
def remove(address: RemoteAddress) -> None:
    """Ask this remote no more."""
    from swarmdata.errors import UnknownNameError
    from swarmdata.hub.remotes import parse_address
    from swarmdata.hub.remotes.addresses import store_remotes

    removed = str(parse_address(address))

    def without(there: tuple[str, ...]) -> tuple[str, ...]:
        if removed not in there:
            raise UnknownNameError("remote", removed, there)
        return tuple(each for each in there if each != removed)

    path = store_remotes(without)
    typer.echo(f"{removed} is no longer in {path}")
    _say_if_overridden()


def _say_if_overridden() -> None:
    import os

    if "SWARMDATA_REMOTES" in os.environ:
        typer.echo("SWARMDATA_REMOTES is set, so this file is not used.", err=True)


def _folder(dataset: str) -> Path:
    """The folder itself, or that of an id in the cache."""
    from swarmdata.hub.catalog.catalog import find_folder

    return find_folder(dataset)


def _cached(dataset_id: str) -> Path:
    from swarmdata.store.cache import cache_folder

    return cache_folder() / "datasets" / dataset_id


def _versioned(dataset: str) -> str:
    """The id with its version: the newest of the package, or as it is.

    Raises:
        AddressError: it is neither an id of the package nor one with a version.
    """
    from swarmdata.behavior_policies.tiers import find_recipe, is_dataset, shipped_recipes
    from swarmdata.hub.remotes.outside_names import split_id

    if is_dataset(dataset):
        return find_recipe(dataset).id
    split_id(dataset, shipped_recipes())
    return dataset
