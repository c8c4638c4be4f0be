"""CardData, everything that the card of a task's dataset is made from."""

from dataclasses import dataclass

from swarmdata.cards.sections.measured_content import MeasuredContent, measure
from swarmdata.registry.published import TaskReferences, references_of
from swarmdata.specs.origins import Origin, task_of
from swarmdata.store import EpisodeTable, Manifest, StoredDataset


@dataclass(frozen=True, eq=False)
class CardData:
    """The content of a card; rendering adds only words."""

    manifest: Manifest
    origin: Origin
    table: EpisodeTable
    measured: MeasuredContent
    references: TaskReferences | None


def card_data_of(stored: StoredDataset) -> CardData:
    """Measures an open dataset of one of the package's tasks.

    Raises:
        SpecError: it was recorded in another environment.
        SchemaError: too few joint steps to estimate anything.
    """
    spec = task_of(stored.recipe, "a card of a task")
    known = references_of(spec.hash())
    return CardData(stored.manifest, stored.recipe, stored.table, measure(stored), known)
