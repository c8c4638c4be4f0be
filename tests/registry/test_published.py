"""The package's files of published datasets and references hold what their readers take as read."""

import re
from collections.abc import Mapping
from importlib.resources import files

from pydantic import ConfigDict, TypeAdapter

from swarmdata.registry.published import (
    PACKAGE_LICENSE,
    Figures,
    Interval,
    Published,
    TaskReferences,
    license_of,
    published,
    references,
)
from swarmdata.registry.recipes import find_recipe
from swarmdata.specs.origins.edit_origin import Edit, Parent

SHA256 = re.compile("[0-9a-f]{64}")
FINITE = ConfigDict(allow_inf_nan=False)


def content(name: str) -> str:
    return (files("swarmdata") / "cards" / name).read_text("utf-8")


def is_possible(figures: Figures) -> bool:
    shares = figures.clean_success, figures.success
    return min(figures.n_steps, figures.n_episodes) >= 1 and 0 <= shares[0] <= shares[1] <= 1


def test_every_published_entry_is_possible() -> None:
    entries = TypeAdapter(dict[str, Published], config=FINITE).validate_json(
        content("published.json"), strict=True
    )
    assert entries == published()
    for name, entry in entries.items():
        digests = entry.recipe_hash, entry.digest, entry.transport_digest
        assert all(map(SHA256.fullmatch, digests)), name
        assert min(entry.n_agents, entry.n_bytes) >= 1, name
        assert all(map(is_possible, (entry, *entry.policies.values()))), name


def test_every_reference_is_possible() -> None:
    entries = TypeAdapter(dict[str, TaskReferences], config=FINITE).validate_json(
        content("references.json"), strict=True
    )
    assert entries == references()
    for name, entry in entries.items():
        assert SHA256.fullmatch(entry.spec_hash), name
        assert entry.n_episodes >= 1, name
        rows: list[Mapping[str, Interval | None]] = [*entry.policies.values(), *entry.gaps.values()]
        found = [each for row in rows for each in row.values() if each is not None]
        assert all(each.low <= each.value <= each.high for each in found), name


def test_edits_of_published_datasets_have_their_license() -> None:
    """A dataset of somebody else that has the name of a published one has another digest."""
    name, entry = next(iter(published().items()))
    recipe = find_recipe(name)

    def edit(*digests: str) -> Edit:
        parents = tuple(Parent(id=name, digest=each, episodes=(0,)) for each in digests)
        content = recipe.model_dump(include={"tier", "spec", "policies"})
        return Edit(**content, id="some-of-it-v0", parents=parents, operation="filter")

    assert license_of(edit(entry.digest)) == PACKAGE_LICENSE
    assert license_of(edit(entry.digest, "0" * 64)) == "unknown"
