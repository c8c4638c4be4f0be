"""The datasets in the cache that the package has no recipe of, as their manifests describe them."""

from pathlib import Path

from swarmdata.errors import DatasetError, SwarmdataError
from swarmdata.hub.catalog.catalog import DatasetInfo
from swarmdata.hub.catalog.identity import misnamed
from swarmdata.hub.catalog.request import cached_ids
from swarmdata.registry.recipes import shipped_recipes
from swarmdata.runtime.documents import MAX_JSON_BYTES
from swarmdata.runtime.regular_files import read_regular
from swarmdata.store import read_manifest
from swarmdata.store.arrays.layout import RECIPE
from swarmdata.store.cache import cache_folder
from swarmdata.store.stored_dataset import check_listing, read_origin


def own_datasets() -> tuple[list[DatasetInfo], list[str]]:
    """Returns the datasets in the cache that the package has no recipe of, by id.

    Only manifests and recipes are read, which takes a millisecond for each.

    Returns:
        Them, and for each folder that is no usable dataset one sentence that says why.
    """
    place = cache_folder() / "datasets"
    found, problems = [], []
    for name in sorted(set(cached_ids(place)) - shipped_recipes().keys()):
        try:
            found.append(_info_of_folder(place / name))
        except (SwarmdataError, OSError) as error:
            problems.append(f"{place / name}: {error}")
    return found, problems


def _info_of_folder(folder: Path) -> DatasetInfo:
    manifest = read_manifest(folder)
    check_listing(folder, manifest)
    recipe = read_origin(folder, manifest, read_regular(folder / RECIPE, MAX_JSON_BYTES), None)
    if (sentence := misnamed(folder, manifest)) is not None:
        raise DatasetError(f"{sentence}.")
    return DatasetInfo(
        id=manifest.id,
        task=recipe.spec.task,
        tier=recipe.tier,
        n_agents=recipe.spec.n_agents,
        n_steps=manifest.n_steps,
        n_episodes=manifest.n_episodes,
        n_bytes=sum(file.size for file in manifest.files.values()),
        score=None,
        digest=manifest.digest,
        is_cached=True,
    )
