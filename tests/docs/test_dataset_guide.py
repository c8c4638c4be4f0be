"""The figures of docs/which-dataset.md are those of the published datasets."""

import re
from pathlib import Path

import pytest

from swarmdata.catalogue.pages.index_page import QUESTIONS
from swarmdata.registry.published import published, references
from swarmdata.registry.recipes import find_recipe

PAGE = Path(__file__).parents[2] / "docs/which-dataset.md"
SHARE = re.compile(r"(\d+\.\d) % of\s+`([\w-]+)`")
ROW = re.compile(r"^\| [^|]+\? \| (.+?) \| (.+?) \|$", re.MULTILINE)
ROWS = ROW.findall(PAGE.read_text(encoding="utf-8"))


@pytest.mark.parametrize(("named", "why"), ROWS)
def test_shares_are_those_of_the_cards(named: str, why: str) -> None:
    entries = [published()[find_recipe(name).id] for name in re.findall(r"`([\w-]+)`", named)]
    shares = {f"{100 * share:.1f}" for e in entries for share in (e.success, e.clean_success)}
    assert set(re.findall(r"(\d+\.\d) %", why)) <= shares


def test_shares_of_named_datasets_are_those_of_the_cards() -> None:
    found = SHARE.findall(PAGE.read_text(encoding="utf-8"))
    assert len(found) == 2
    for share, name in found:
        assert f"{100 * published()[find_recipe(name).id].success:.1f}" == share, name


def test_the_table_of_the_readme_is_that_of_the_published_datasets() -> None:
    text = (PAGE.parents[1] / "README.md").read_text(encoding="utf-8")
    head, _, *rows = re.findall(r"^\|.*\|$", text.partition("\n## Datasets\n")[2], re.MULTILINE)
    tiers = [tier.strip() for tier in head.split("|")[2:-1]]
    rows = rows[: next(k for k, row in enumerate(rows) if row.startswith("| score"))]
    for row in rows:
        name, *cells = (cell.strip(" `") for cell in row.split("|")[1:-1])
        found = [published().get(f"{name}-{tier}-v1") for tier in tiers]
        assert cells == [f"{100 * e.success:.1f}" if e else "" for e in found], name
    assert len(rows) == 22


def test_the_readme_counts_the_datasets() -> None:
    text = (PAGE.parents[1] / "README.md").read_text(encoding="utf-8")
    assert f"**{sum('-mini-' not in name for name in published())} datasets of a million" in text


def test_shares_of_tag_are_those_that_were_measured() -> None:
    text = " ".join((PAGE.parent / "tasks.md").read_text(encoding="utf-8").split())
    for tier, recorded in (("expert", "tag-expert"), ("medium", "tag-medium")):
        measured = references()["tag-pursuers"].policies[tier]["success"]
        assert measured is not None
        share = f"{100 * published()[f'{recorded}-v1'].success:.1f}"
        assert f"{100 * measured.value:.1f} %" in text
        assert f"in {share} % of `{recorded}`" in text


def test_every_tier_is_on_the_page() -> None:
    text = PAGE.read_text(encoding="utf-8")
    for name in published():
        assert re.search(find_recipe(name).tier.replace("-", "[- ]"), text, re.IGNORECASE), name


def test_sizes_are_those_of_the_cards() -> None:
    sizes = [entry.n_bytes / 1e9 for name, entry in published().items() if "-mini-" not in name]
    assert f"{min(sizes):.1f} to {max(sizes):.1f} GB" in PAGE.read_text(encoding="utf-8")
    mini = published()["coop_nav-medium-mini-v1"]
    facts = f"{mini.n_bytes / 1e6:.0f} MB, {100 * mini.success:.1f} % of its episodes"
    assert facts in PAGE.read_text(encoding="utf-8")


def test_the_catalogue_asks_the_same_questions() -> None:
    rows = re.findall(r"^\| ([^|]+\?) \| (.+?) \| .+ \|$", PAGE.read_text(encoding="utf-8"), re.M)
    asked = {question: tuple(re.findall(r"`([\w-]+)`", named)) for question, named in rows}
    last = "depend on sensors and radios?"  # which every dataset answers

    assert {question: names for question, names, _ in QUESTIONS} == {
        question: names for question, names in asked.items() if question != last
    }
    assert last in asked
