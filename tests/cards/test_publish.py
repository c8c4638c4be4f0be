"""Results of studies are written into cards that exist; the committed cards have the newest."""

import re
import shutil
from importlib.resources import files
from pathlib import Path

import pytest

from swarmdata.cards.committed_studies import committed_studies
from swarmdata.cards.publish import measured_sections, refresh_cards
from swarmdata.errors import SchemaError
from swarmdata.registry.published import published

CARDS = Path(str(files("swarmdata.cards"))) / "published"
ID = "coop_nav-expert-mini-v1"


@pytest.fixture
def cards(tmp_path: Path) -> Path:
    shutil.copy(CARDS / f"{ID}.md", tmp_path)
    return tmp_path


def test_the_committed_cards_show_the_committed_references_and_studies() -> None:
    studied = {row["digest"] for study in committed_studies() for row in study.estimates}
    for key, entry in published().items():
        card = (CARDS / f"{key}.md").read_text("utf-8")
        assert f"{measured_sections(key, committed_studies())}\n## Coverage\n" in card, key
        assert ("No results on this dataset" in card) == (entry.digest not in studied), key


def test_only_the_sections_of_policies_change(cards: Path) -> None:
    card = cards / f"{ID}.md"
    whole = card.read_text("utf-8")
    table = whole[whole.index("| gap to |") : whole.index("\n## Baselines")]
    card.write_text(whole.replace(table, f"{table}\n{table}"))
    assert refresh_cards(cards, committed_studies()) == [card], "of reference scores"
    assert card.read_text("utf-8") == whole
    assert refresh_cards(cards, committed_studies()) == []
    assert refresh_cards(cards, ()) == [card]
    without = card.read_text("utf-8")
    assert "## Baselines\n\nNo results on this dataset yet.\n\n## " in without
    headings = [re.findall("^## .*$", text, re.MULTILINE) for text in (whole, without)]
    assert headings[0] == headings[1]
    assert refresh_cards(cards, committed_studies()) == [card]
    assert card.read_text("utf-8") == whole


def test_a_folder_without_cards_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(SchemaError, match="no card of a published dataset"):
        refresh_cards(tmp_path, committed_studies())


@pytest.mark.parametrize("change", ["digest", "references", "baselines"])
def test_a_card_of_other_data_is_refused_and_kept(change: str, cards: Path) -> None:
    card = cards / f"{ID}.md"
    text = card.read_text("utf-8")
    lost = {
        "digest": published()[ID].digest,
        "references": "\n## Reference scores\n",
        "baselines": "\n## Baselines\n",
    }[change]
    card.write_text(text.replace(lost, "other"))
    before = card.read_bytes()
    with pytest.raises(SchemaError, match=rf"card {ID} --out"):
        refresh_cards(cards, committed_studies())
    assert card.read_bytes() == before
