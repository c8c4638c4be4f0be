"""Writes the results of studies into cards that exist, without the data of their datasets."""

from collections.abc import Sequence
from pathlib import Path

from swarmdata.cards.committed_studies import CommittedStudy
from swarmdata.cards.sections.baselines import BASELINES_TITLE, baselines_section
from swarmdata.errors import SchemaError
from swarmdata.registry.published import published
from swarmdata.store import write_file


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
