"""README.md and docs/: links lead somewhere, and whatever they name exists."""

import dataclasses
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer

from swarmdata.cli.main import app
from swarmdata.registry.components import OFFLINE_ALGORITHMS, ONLINE_ALGORITHMS, resolve
from tests.support.package_sources import sources

ROOT = Path(__file__).parents[2]
README = ROOT / "README.md"
PAGES = sorted((ROOT / "docs").rglob("*.md"))
DOCUMENTS = [README, ROOT / "CONTRIBUTING.md", *PAGES]
README_BYTES = 8_000

UNLISTED = ("fault-tests.md", "measurements.md")
"""Pages of `docs` for maintainers."""

MEASUREMENT = re.compile(r"tests\.benchmarks\.(\w+)[^`]*`(?!\s+of\s+revision)")
"""A command of the present revision that measures something."""

LINK = re.compile(r"\]\(([^)\s]+)\)|(?:src|href)=\"([^\"]+)\"")


def name_of(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


def anchors(page: Path) -> set[str]:
    """Anchors of a page's headings, as GitHub makes them."""
    headings = re.findall(r"^#+ (.+)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in headings}


def commands(group: Any, path: tuple[str, ...] = ()) -> dict[str, Any]:
    """Every command of the command line, by its words."""
    found: dict[str, Any] = {}
    for name, command in group.commands.items():
        is_group = hasattr(command, "commands")
        found |= (
            commands(command, (*path, name)) if is_group else {" ".join((*path, name)): command}
        )
    return found


def setting_names(config: Any, prefix: str = "") -> Iterator[str]:
    """Names of all settings of a configuration, those of its sections with their section."""
    for field in dataclasses.fields(config):
        value = getattr(config, field.name)
        if dataclasses.is_dataclass(value):
            yield from setting_names(value, f"{prefix}{field.name}.")
        else:
            yield prefix + field.name


COMMANDS = commands(typer.main.get_command(app))


def test_the_readme_is_short() -> None:
    assert len(README.read_bytes()) <= README_BYTES


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_a_page_starts_with_its_title_and_purpose(page: Path) -> None:
    title, blank, purpose = page.read_text(encoding="utf-8").splitlines()[:3]
    assert title.startswith("# ")
    assert not blank
    assert purpose.lstrip("*")[0].isupper() or purpose[0] == "`"


@pytest.mark.parametrize("page", DOCUMENTS, ids=name_of)
def test_links_lead_somewhere(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    for target in (first or second for first, second in LINK.findall(text)):
        if target.startswith(("https://", "http://")):
            continue
        path, _, anchor = target.partition("#")
        linked = (page.parent / path).resolve() if path else page
        assert linked.exists(), f"{target} does not exist"
        assert ROOT in linked.parents, f"{target} leads out of the repository"
        if anchor:
            assert anchor in anchors(linked), f"{target}: there is no such heading"


@pytest.mark.parametrize(
    ("folder", "pages"),
    [
        ("docs", "*.md"),
        ("docs", "tutorials/*.md"),
        ("docs/results", "*.md"),
        ("docs/worlds", "*.md"),
    ],
)
def test_the_index_lists_every_page(folder: str, pages: str) -> None:
    index = ROOT / folder / "README.md"
    text = index.read_text(encoding="utf-8")
    linked = {first.partition("#")[0] for first, _ in LINK.findall(text)}
    found = {page.relative_to(index.parent).as_posix() for page in index.parent.glob(pages)}
    assert found - {index.name, *UNLISTED} <= linked


def test_every_command_is_listed_once() -> None:
    text = (ROOT / "docs" / "command-line.md").read_text(encoding="utf-8")
    listed = re.findall(r"^\| `([a-z -]+)` \|", text, re.MULTILINE)
    assert sorted(listed) == sorted(COMMANDS)


def test_documented_settings_exist() -> None:
    pytest.importorskip("torch", reason="algorithms need torch")
    tables = (("online algorithm", ONLINE_ALGORITHMS), ("algorithm", OFFLINE_ALGORITHMS))
    configs = [resolve(kind, table, name).Config() for kind, table in tables for name in table]
    known = {name for config in configs for name in setting_names(config)}
    for page in DOCUMENTS:
        used = set(re.findall(r"--set ([a-z][\w.]*)=", page.read_text(encoding="utf-8")))
        assert used <= known, f"{page.name}: unknown {used - known}"


def test_commands_that_measure_exist() -> None:
    texts = {name_of(page): page.read_text(encoding="utf-8") for page in DOCUMENTS}
    texts |= {path.as_posix(): text for path, text in sources().items()}
    cited = {name: set(MEASUREMENT.findall(text)) for name, text in texts.items()}
    known = {file.stem for file in (ROOT / "tests/benchmarks").glob("*.py")}
    missing = {name: found - known for name, found in cited.items() if found - known}
    assert not missing
    assert set().union(*cited.values())
