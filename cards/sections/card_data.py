"""Facts, everything that a card is made from."""

from dataclasses import dataclass

from swarmdata.cards.sections.measured_content import Findings, measure
from swarmdata.registry.published import TaskReferences, references_of
from swarmdata.specs.origins import Origin, task_of
from swarmdata.store import EpisodeTable, Manifest, StoredDataset


@dataclass(frozen=True, eq=False)
class Facts:
    """The content of a card; rendering adds only words."""

    manifest: Manifest
    recipe: Origin
    table: EpisodeTable
    findings: Findings
    references: TaskReferences | None


def facts_of(stored: StoredDataset) -> Facts:
    """Measures an open dataset of one of the package's tasks.

    Raises:
        SpecError: it was recorded in another environment.
        SchemaError: too few joint steps to estimate anything.
    """
    spec = task_of(stored.recipe, "a card of a task")
    known = references_of(spec.hash())
    return Facts(stored.manifest, stored.recipe, stored.table, measure(stored), known)
