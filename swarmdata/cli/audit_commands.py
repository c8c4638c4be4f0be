"""`swarmdata audit`: whether a dataset's data match its metadata."""

from pathlib import Path
from typing import Annotated

import typer


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
    from swarmdata.hub.catalog.catalog import dataset_folder
    from swarmdata.hub.remotes.outside_names import is_folder
    from swarmdata.registry.recipes import find_recipe
    from swarmdata.store.cache import cache_folder

    for path in (Path(dataset), cache_folder() / "datasets" / dataset):
        if is_folder(path):
            return path
    recipe = find_recipe(dataset)
    folder = dataset_folder(recipe)
    if not folder.is_dir():
        raise DatasetNotFoundError(
            f"{recipe.id} is not in the cache, expected at {folder}. "
            f"Get it with: swarmdata generate {recipe.id}"
        )
    return folder
