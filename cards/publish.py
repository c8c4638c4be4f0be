"""Cards as they are published, `<id>.md` with a picture: from data, or with new measurements."""

from collections.abc import Sequence
from pathlib import Path

from swarmdata.cards.card import card_of
from swarmdata.cards.committed_studies import CommittedStudy
from swarmdata.cards.pictures.sheet import draw_card
from swarmdata.cards.references import REFERENCES_TITLE, references_section
from swarmdata.cards.sections.baselines import BASELINES_TITLE, baselines_section
from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import SchemaError
from swarmdata.registry.published import published, references_of
from swarmdata.registry.recipes import find_recipe
from swarmdata.runtime.output_folder import OutputKind, filled
from swarmdata.specs.origins import task_of
from swarmdata.store import write_file

CARDS = OutputKind("folder of cards")


def publish_card(folder: Path, out: Path, *, pictures: bool = True) -> list[Path]:
    """Writes the card of a finished dataset to another folder and returns what it wrote.

    Without `pictures`, the text has a histogram in place of `<id>.png`. Other errors are those of
    `card_of`.

    Raises:
        OutputError: `out` has files that are no cards of this package.
        MissingExtraError: pictures need matplotlib or Pillow, which is not installed.
    """
    dataset = Dataset.open(folder, verify="none")
    text, picture = out / f"{dataset.id}.md", out / f"{dataset.id}.png"
    with filled(out, CARDS) as written:
        if pictures:
            draw_card(dataset, written / picture.name)
        card = card_of(folder, picture.name if pictures else None)
        (written / text.name).write_text(card, encoding="utf-8")
    return [text, picture] if pictures else [text]


def refresh_cards(folder: Path, studies: Sequence[CommittedStudy]) -> list[Path]:
    """Writes reference scores and baselines again in a folder's cards; returns those that changed.

    Raises:
        SchemaError: there is no card, or one is of other data or lacks one of these sections.
        StudyError: the plan of a study cannot be read.
    """
    files = {key: folder / f"{key}.md" for key in published() if (folder / f"{key}.md").is_file()}
    if not files:
        raise SchemaError(f"{folder} has no card of a published dataset, expected ID.md.")
    changed = []
    for key, file in files.items():
        digest = published()[key].digest
        old = file.read_text(encoding="utf-8")
        before, references_title, rest = old.partition(REFERENCES_TITLE)
        _, baselines_title, rest = rest.partition(BASELINES_TITLE)
        _, next_title, after = rest.partition("\n## ")
        if digest not in old or not (references_title and baselines_title and next_title):
            raise SchemaError(
                f"{file} is not the card of the published {key} (digest {digest[:12]}) with "
                f"sections of reference scores and baselines. Write it from the data: `swarmdata "
                f"card {key} --out {folder}`."
            )
        new = f"{before}{measured_sections(key, studies)}{next_title}{after}"
        if new != old:
            write_file(file, new.encode())
            changed.append(file)
    return changed


def measured_sections(dataset_id: str, studies: Sequence[CommittedStudy]) -> str:
    """Returns what a published dataset's card says of policies: reference scores and baselines."""
    entry, spec = published()[dataset_id], task_of(find_recipe(dataset_id), "a card")
    references = references_section(references_of(spec.hash()), spec, entry.mean_return)
    return references + baselines_section(dataset_id, entry.digest, studies)
