"""The navigation of the site: a sidebar from `docs/README.md` and what is generated."""

import posixpath
import re
from collections.abc import Iterable
from pathlib import Path

REFERENCE = (
    ("Tasks", "reference/tasks/index"),
    ("Datasets", "cards/published/index"),
    ("Algorithms", "reference/algorithms/index"),
    ("Formats", "reference/formats/index"),
    ("Layouts of arrays", "reference/layouts/index"),
    ("Schemas of files", "reference/schemas/index"),
    ("Python reference", "reference/api/index"),
    ("Studies", "cards/studies/index"),
)
"""Title and page of each part that is generated from registries, in the section of that name."""

LISTING = (
    "docs/results", "reference/tasks", "reference/algorithms", "reference/formats",
    "reference/layouts", "reference/schemas", "reference/api",
)  # fmt: skip
"""Folders whose pages the sidebar lists below their index.

Other pages, such as the cards of all datasets, are found in the tables of their index and by the
search: a sidebar of hundreds of names helps nobody, and makes every page slow to build.
"""

SECTION = re.compile(r"^## (.+?)\n(.*?)(?=^## |\Z)", re.MULTILINE | re.DOTALL)
PAGE = re.compile(r"^\| \[([^\]]+)\]\(([^)#]+)\)", re.MULTILINE)

UNSEARCHED = "cards/published/"
"""Pages that the search finds by their title only: 80 cards share most of their words."""

CATALOGUE = """<a href="catalogue/index.html">The catalogue of this site</a> shows episodes.

"""
"""A link on the home page; HTML, because the catalogue is none of Sphinx's pages."""


def add_navigation(tree: Path, *, has_catalogue: bool) -> None:
    """Adds the tables of contents to staged pages, by the sections of `docs/index.md`."""
    overview = tree / "docs/index.md"
    text = overview.read_text(encoding="utf-8")
    contents = ""
    for _, caption, pages in (match.group(0, 1, 2) for match in SECTION.finditer(text)):
        listed_pages = [(title, _from_docs(target)) for title, target in PAGE.findall(pages)]
        generated = REFERENCE if caption == "Reference" else ()
        entries = (f"{title} <{page}>" for title, page in (*listed_pages, *generated))
        contents += toctree(entries, f":caption: {caption}\n")
    home = tree / "index.md"
    front = home.read_text(encoding="utf-8")
    if has_catalogue:
        front = front.replace("## Results\n", f"{CATALOGUE}## Results\n", 1)
    home.write_text(front + contents, encoding="utf-8")
    listed = {f"{_from_docs(target)}.md" for _, target in PAGE.findall(text)}
    listed |= {"index.md", *(f"{page}.md" for _, page in REFERENCE)}
    for folder in LISTING:
        listed |= _list_folder(tree, folder)
    for page in tree.rglob("*.md"):
        path = page.relative_to(tree).as_posix()
        if path not in listed:
            head = "orphan: true\n" + "nosearch: true\n" * path.startswith(UNSEARCHED)
            page.write_text(f"---\n{head}---\n\n{page.read_text(encoding='utf-8')}")


def toctree(entries: Iterable[str], options: str = "") -> str:
    """A hidden table of contents, which the sidebar shows."""
    lines = "".join(f"{entry}\n" for entry in entries)
    return f"\n```{{toctree}}\n:hidden:\n{options}\n{lines}```\n"


def _list_folder(tree: Path, folder: str) -> set[str]:
    """Lists the pages of a folder below its index, and returns their paths."""
    index = tree / folder / "index.md"
    pages = sorted(page for page in index.parent.glob("*.md") if page != index)
    text = index.read_text(encoding="utf-8")
    index.write_text(text + toctree(page.stem for page in pages), encoding="utf-8")
    return {page.relative_to(tree).as_posix() for page in pages}


def _from_docs(target: str) -> str:
    """A link of `docs/README.md` as the name of a page of the site."""
    return posixpath.normpath(f"docs/{target}").removesuffix(".md").removesuffix(".ipynb")
