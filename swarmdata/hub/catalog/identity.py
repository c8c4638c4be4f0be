"""Identifies a dataset: the published one, another one under a published name, or unknown.

The digests of arrays and recipe decide; the recipe includes the spec.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from swarmdata.registry.published import Published, changed_versions, published
from swarmdata.registry.recipes import shipped_recipes
from swarmdata.runtime.outside_names import is_id
from swarmdata.store.manifest import Manifest, was_built_here

Kind = Literal["published", "rebuilt", "another", "unknown"]


@dataclass(frozen=True)
class Identity:
    """The verdict on a dataset."""

    kind: Kind
    """`published`: arrays and recipe are those published under its id. `rebuilt`: built here from
    the published recipe, with other arrays. `another`: it has the id of a published or shipped
    dataset, and is not that one. `unknown`: nothing is published under its id."""
    sentence: str  # the verdict in words, with the digests

    @property
    def is_as_named(self) -> bool:
        """Whether the dataset may be the one that its id names."""
        return self.kind in ("published", "unknown")


def misnamed(folder: Path, manifest: Manifest) -> str | None:
    """Says that a folder is named like another dataset than it holds; None if it is not."""
    name = folder.resolve().name
    if name == manifest.id or not is_id(name):
        return None
    return (
        f"the folder {folder} is named like {name}, and holds {manifest.id}. Rename the folder to "
        f"{manifest.id}, or to what is no id of a dataset"
    )


def judge(manifest: Manifest) -> Identity:
    """Identifies a dataset by its manifest alone; its files are not read."""
    entry = published().get(manifest.id)
    if entry is not None:
        return _compared(manifest, entry)
    recipe = shipped_recipes().get(manifest.id)
    if recipe is not None and recipe.hash() != manifest.recipe_hash:
        return Identity(
            "another",
            f"this is another dataset under the shipped name {manifest.id}: its recipe is "
            f"{manifest.recipe_hash[:12]}, the shipped one is {recipe.hash()[:12]}",
        )
    return Identity(
        "unknown",
        f"no digest is published for {manifest.id}, so there is nothing to compare it with",
    )


def _compared(manifest: Manifest, entry: Published) -> Identity:
    same_arrays = manifest.digest == entry.digest
    same_recipe = manifest.recipe_hash == entry.recipe_hash
    if same_arrays and same_recipe:
        return Identity("published", f"this is the published dataset {manifest.id}")
    digests = f"digest {manifest.digest[:12]}, published {entry.digest[:12]}"
    recipes = f"SHA-256 {manifest.recipe_hash[:12]}, published {entry.recipe_hash[:12]}"
    if same_recipe and was_built_here(manifest):
        return Identity("rebuilt", _rebuilt(manifest, entry, digests))
    if same_arrays:
        what = (
            "it has the published arrays, and a recipe that was not published "
            f"({recipes}), so what the recipe says of task, tier and policies may be wrong"
        )
    elif same_recipe:
        what = (
            f"it has the published recipe, and arrays that were not published ({digests}). There "
            "is no record that they were built on this machine. They may have been changed, or "
            f"built where the simulation gives other bits; its manifest says{_made(manifest)}"
        )
    else:
        what = f"neither arrays ({digests}) nor recipe ({recipes}) are those that were published"
    start = f"this is another dataset under the published name {manifest.id}"
    return Identity("another", f"{start}: {what}")


def _rebuilt(manifest: Manifest, entry: Published, digests: str) -> str:
    changed = changed_versions(entry.made_with, manifest.provenance)
    cause = (
        f"with {', '.join(changed)}"
        if changed
        else "with the versions it was published with, so this machine computes something else"
    )
    return (
        f"this was built here from the published recipe of {manifest.id}, and has other arrays "
        f"({digests}). It was built {cause}. It is usable, but results on it are not exactly "
        "comparable"
    )


def _made(manifest: Manifest) -> str:
    made = ", ".join(f"{name} {version}" for name, version in sorted(manifest.provenance.items()))
    return f" that they were made with {made}" if made else " nothing about how they were made"
