"""`swarmdata audit ...`: whether a dataset is what it says."""

from pathlib import Path
from typing import Annotated

import typer


def audit(
    dataset: Annotated[
        str, typer.Argument(metavar="ID_OR_PATH", help="an id in the cache, or a dataset's folder")
    ],
    sample: Annotated[int, typer.Option(min=0, help="episodes to replay; 0 for none")] = 64,
    as_json: Annotated[bool, typer.Option("--json", help="print JSON")] = False,
) -> None:
    """Check what a dataset says of itself, and replay a sample of it.

    Exit code 0: no problems; 1: problems, each named; 2: it cannot be read.
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
    """The path itself, or the folder of an id in the cache; nothing is built or fetched."""
    from swarmdata.behavior_policies.tiers import find_recipe
    from swarmdata.errors import DatasetNotFoundError
    from swarmdata.hub.catalog.catalog import dataset_folder
    from swarmdata.hub.remotes.outside_names import is_folder
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
