"""Staged pages: the Markdown of the repository with what it links to, and a sidebar, for a site."""

import posixpath
import re
import shutil
from collections.abc import Iterable, Mapping
from pathlib import Path, PurePosixPath

ROOT = Path(__file__).parents[2]

SEEDS = ("README.md", "docs/README.md", "docs/results/*.md", "docs/tutorials/*.ipynb",
         "cards/published/*.md", "cards/studies/*/report.md")  # fmt: skip
"""Pages that the site has whether or not another page links to them."""

WORLDS = "docs/worlds"  # tables of all presets, which the site has on the generated page of each

PRESETS = "reference/presets/index.md"

FRONT_MATTER = re.compile(r"\A---\n.*?\n---\n", re.DOTALL)
PARAGRAPH_TAG = re.compile(r"</?p>")
CODE_OR_LINK = re.compile(
    r"^(?P<ticks>```+)[^\n`]*\n.*?^(?P=ticks)[ \t]*$|`[^`\n]+`"
    r"|(?P<open>\]\(|(?:src|href)=\")(?P<address>[^)\s\"]+)(?=[)\"\s])",
    re.MULTILINE | re.DOTALL,
)
"""Fenced blocks and code within a line, in which nothing is a link; and addresses of links."""

TUTORIAL_LINK = re.compile(r"(\]\([\w-]+)\.md(?=[)#])")  # the site has the other's notebook

Pages = dict[str, str]  # text of pages by their path on the site


class BrokenLinkError(ValueError):
    """A page links to something that the repository lacks."""


def site_path(path: str) -> str:
    """Where a file or a folder of the repository is on the site.

    A folder is its index, a tutorial the notebook that has its outputs, `WORLDS` the presets.
    """
    here = PurePosixPath(path)
    if here.is_relative_to(WORLDS):
        return PRESETS
    if here.name == "README.md":
        return (here.parent / "index.md").as_posix()
    if here.match("docs/tutorials/*.md"):
        return here.with_suffix(".ipynb").as_posix()
    is_folder = (ROOT / path).is_dir() or path.endswith("/")
    return (here / "index.md").as_posix() if is_folder else path


def stage_pages(out: Path, generated: Mapping[str, str]) -> None:
    """Writes the tree into an empty folder, with the generated pages, by their path on the site.

    Raises:
        BrokenLinkError: a page links to what is neither in the repository nor generated.
    """
    waiting = [path.relative_to(ROOT).as_posix() for seed in SEEDS for path in ROOT.glob(seed)]
    seen = set(waiting)
    while waiting:
        path = waiting.pop()
        target = out / site_path(path)
        target.parent.mkdir(parents=True, exist_ok=True)
        if path.endswith(".ipynb"):
            text = (ROOT / path).read_text(encoding="utf-8")
            target.write_text(TUTORIAL_LINK.sub(r"\1.ipynb", text), encoding="utf-8")
        elif path.endswith(".md"):
            text, linked = staged_text(path, (ROOT / path).read_text(encoding="utf-8"), generated)
            target.write_text(text, encoding="utf-8")
            waiting += sorted(linked - seen)
            seen |= linked
        else:
            shutil.copyfile(ROOT / path, target)
    for name, text in generated.items():
        (out / name).parent.mkdir(parents=True, exist_ok=True)
        (out / name).write_text(text, encoding="utf-8")
        for address in filter(None, (match["address"] for match in CODE_OR_LINK.finditer(text))):
            file = posixpath.normpath(posixpath.join(name, "..", address.partition("#")[0]))
            if file not in generated and not (out / file).exists() and (ROOT / file).is_file():
                (out / file).parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(ROOT / file, out / file)


def staged_text(path: str, text: str, generated: Mapping[str, str]) -> tuple[str, set[str]]:
    """The text of a page as the site has it, and the files of the repository that it links to.

    Raises:
        BrokenLinkError: a link leads neither to a file nor to a generated page.
    """
    linked: set[str] = set()

    def rewrite(match: re.Match[str]) -> str:
        address, hash_mark, anchor = (match["address"] or "").partition("#")
        if not address or "://" in address or address.startswith("mailto:"):
            return match[0]
        file = (ROOT / path).parent.joinpath(address).resolve().relative_to(ROOT).as_posix()
        target = site_path(file)
        if target not in generated:
            source = f"{file}/README.md" if (ROOT / file).is_dir() else file
            if target.endswith(".ipynb") and file.endswith(".md"):
                source = target
            if not (ROOT / source).is_file():
                raise BrokenLinkError(
                    f"{path} links to {match['address']}: there is no such page or file. Correct "
                    "the link."
                )
            linked.add(source)
        link = posixpath.relpath(target, PurePosixPath(site_path(path)).parent)
        return f"{match['open']}{link}{hash_mark}{anchor}"

    text = PARAGRAPH_TAG.sub("", FRONT_MATTER.sub("", text))
    if not text.lstrip().startswith("# "):
        text = f"# {PurePosixPath(path).stem.capitalize()}\n\n{text}"
    return CODE_OR_LINK.sub(rewrite, text), linked


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
"""Folders whose pages the sidebar lists; others, as the cards, are in the table of their index."""

SECTION = re.compile(r"^## (.+?)\n(.*?)(?=^## |\Z)", re.MULTILINE | re.DOTALL)
PAGE = re.compile(r"^\| \[([^\]]+)\]\(([^)#]+)\)", re.MULTILINE)

UNSEARCHED = "cards/published/"  # found by title only: they share most words

CATALOGUE = """<a href="catalogue/index.html">The catalogue of this site</a> shows episodes.

"""
"""A link on the home page; HTML, because the catalogue is none of Sphinx's pages."""


def add_navigation(tree: Path, *, has_catalogue: bool) -> None:
    """Adds the tables of contents to staged pages, by the sections of `docs/index.md`."""
    overview = tree / "docs/index.md"
    text = overview.read_text(encoding="utf-8")
    contents = ""
    for caption, pages in SECTION.findall(text):
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
    return posixpath.normpath(f"docs/{target}").removesuffix(".md").removesuffix(".ipynb")
