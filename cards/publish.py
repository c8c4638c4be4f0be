"""Cards as they are published, `<id>.md` with a picture: written from data, or from new studies."""

from collections.abc import Sequence
from pathlib import Path

from swarmdata.cards.card import card_of
from swarmdata.cards.committed_studies import CommittedStudy
from swarmdata.cards.pictures.sheet import draw_card
from swarmdata.cards.sections.baselines import BASELINES_TITLE, baselines_section
from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import SchemaError
from swarmdata.registry.published import published
from swarmdata.runtime.output_folder import OutputKind, filled
from swarmdata.store import write_file

CARDS = OutputKind("folder of cards")


def publish_card(folder: Path, out: Path, *, pictures: bool = True) -> list[Path]:
    """Writes the card of a finished dataset to another folder and returns what it wrote.

    Args:
        folder: the dataset's.
        out: folder to write to; made if absent.
        pictures: whether to draw `<id>.png`; the text has a histogram in its place otherwise.

    Raises:
        DatasetError: the dataset cannot be used.
        OutputError: `out` has files that are no cards of this package.
        MissingExtraError: pictures need matplotlib or Pillow, which is not installed.
        SchemaError: a check that the card reports did not pass.
        SpecError: something stored has no description.
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
    """Writes the section of baselines again in the cards of published datasets.

    The other sections come from the data, and stay as they are.

    Args:
        folder: with cards, `<id>.md`, as `publish_card` writes them.
        studies: whose results the cards show.

    Returns:
        The cards that changed.

    Raises:
        SchemaError: there is no card, or one is of other data or has no such section.
        StudyError: the plan of a study cannot be read.
    """
    files = {key: folder / f"{key}.md" for key in published() if (folder / f"{key}.md").is_file()}
    if not files:
        raise SchemaError(f"{folder} has no card of a published dataset, expected ID.md.")
    changed = []
    for key, file in files.items():
        entry = published()[key]
        old = file.read_text(encoding="utf-8")
        before, title, rest = old.partition(BASELINES_TITLE)
        _, next_title, after = rest.partition("\n## ")
        if entry.digest not in old or not title or not next_title:
            raise SchemaError(
                f"{file} is not the card of the published {key} (digest {entry.digest[:12]}) with "
                f"a section of baselines. Write it from the data: `swarmdata card {key} --out "
                f"{folder}`."
            )
        section = baselines_section(key, entry.digest, studies)
        new = f"{before}{section}{next_title}{after}"
        if new != old:
            write_file(file, new.encode())
            changed.append(file)
    return changed
