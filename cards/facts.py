"""Facts, everything that a card is made from."""

from dataclasses import dataclass
from pathlib import Path

from swarmdata.cards.findings import Findings, measure
from swarmdata.cards.schema import TaskReferences, references_of
from swarmdata.errors import SchemaError
from swarmdata.spec import Recipe
from swarmdata.store import EpisodeTable, Manifest, open_store


@dataclass(frozen=True, eq=False)
class Facts:
    """The content of a card; rendering adds only words."""

    manifest: Manifest
    recipe: Recipe
    table: EpisodeTable
    findings: Findings
    references: TaskReferences | None


def facts_of(folder: Path) -> Facts:
    """Reads and measures a finished dataset.

    Raises:
        DatasetError: the dataset cannot be used.
        SchemaError: too few joint steps to estimate anything.
    """
    stored = open_store(folder, verify="none")
    if not isinstance(stored.recipe, Recipe):
        raise SchemaError(f"{stored.manifest.id} was not made from a recipe, cards need one")
    references = references_of(stored.recipe.spec.hash())
    return Facts(stored.manifest, stored.recipe, stored.table, measure(stored), references)
