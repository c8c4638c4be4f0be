"""Writes a card as it is published: `<id>.md`, and beside it the picture that it shows."""

from pathlib import Path

from swarmdata.cards.card import card_of
from swarmdata.cards.pictures.sheet import draw_card
from swarmdata.datasets.dataset import Dataset
from swarmdata.runtime.output_folder import OutputKind, filled

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
