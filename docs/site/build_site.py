"""Builds the site: stages the pages, writes the generated ones, runs Sphinx strictly, checks links.

    python -m docs.site.build_site --out dist/docs

The site is a folder of static files, for any web host or for `file://`.
"""

import argparse
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import unquote, urlsplit

import swarmdata
from docs.site.algorithm_pages import algorithm_pages
from docs.site.api_pages import api_pages
from docs.site.data_pages import data_pages
from docs.site.schema_pages import schema_pages
from docs.site.staged_pages import add_navigation, stage_pages
from docs.site.task_pages import task_pages
from swarmdata.catalogue.build_catalogue import CatalogueChoices, build_catalogue

HERE = Path(__file__).parent
MARK = ".swarmdata-docs"  # file that says that a folder is a site, which may be replaced

NAME = re.compile(r"\sid=\"([^\"]+)\"")
ADDRESS = re.compile(r"<(?:a|img|link|script)\b[^>]*?\s(?:href|src)=\"([^\"]+)\"")


def generated_pages() -> dict[str, str]:
    """Every page that registries and models give, by its path on the site."""
    return {**task_pages(), **data_pages(), **algorithm_pages(), **schema_pages(), **api_pages()}


def stage(tree: Path, *, has_catalogue: bool) -> None:
    """Writes everything that Sphinx reads into an empty folder."""
    stage_pages(tree, generated_pages())
    add_navigation(tree, has_catalogue=has_catalogue)


def build(out: Path, datasets: list[str], *, jobs: int) -> None:
    """Builds the site; an earlier one at `out` is replaced once the new one is complete.

    Without datasets, there is no catalogue.

    Raises:
        SystemExit: Sphinx warned, a link leads nowhere, or the folder is no site.
    """
    if out.exists() and not (out / MARK).exists() and any(out.iterdir()):
        raise SystemExit(f"{out} holds other files. Name an empty folder, or one with a site.")
    out.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=out.parent, prefix=f".{out.name}-") as folder:
        tree, site = Path(folder, "pages"), Path(folder, "site")
        stage(tree, has_catalogue=bool(datasets))
        sphinx = [sys.executable, "-m", "sphinx", "-b", "html", "-c", str(HERE), "-j", str(jobs)]
        strict = ["-W", "--keep-going", "-q", "-d", str(Path(folder, "doctrees"))]
        if subprocess.run([*sphinx, *strict, str(tree), str(site)], check=False).returncode:
            raise SystemExit("Sphinx found what is above; the earlier site stays as it was.")
        if datasets:
            build_catalogue(datasets, site / "catalogue", CatalogueChoices())
        if broken := sorted(broken_links(site)):
            raise SystemExit("These links lead nowhere:\n" + "\n".join(broken))
        (site / MARK).touch()
        if out.exists():
            shutil.rmtree(out)
        site.rename(out)
    files = [path for path in out.rglob("*") if path.is_file()]
    n_pages = sum(path.suffix == ".html" for path in files)
    size = sum(path.stat().st_size for path in files) / 1e6
    sys.stdout.write(f"{out / 'index.html'}: {n_pages} pages, {size:.0f} MB\n")


def broken_links(site: Path) -> Iterator[str]:
    """Addresses in the pages of a site that lead to no file of it, each with its page."""
    texts = {page: page.read_text(encoding="utf-8") for page in site.rglob("*.html")}
    names = {page: set(NAME.findall(text)) for page, text in texts.items()}
    for page, text in texts.items():
        for address in ADDRESS.findall(text):
            link = urlsplit(address)
            if link.scheme:
                continue
            target = (page.parent / unquote(link.path)).resolve() if link.path else page
            anchor, known = unquote(link.fragment), names.get(target)
            if "=" in anchor:  # what a page shows, which its script reads
                anchor = ""
            if not target.exists() or (anchor and known is not None and anchor not in known):
                yield f"{page.relative_to(site)}: {address}"


def main() -> None:
    """Reads the command line and builds the site."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=Path("dist/docs"), help="folder of the site")
    parser.add_argument(
        "--catalogue", nargs="*", metavar="ID",
        help="datasets whose episodes the site shows; default: the minis in the cache",
    )  # fmt: skip
    parser.add_argument("--jobs", type=int, default=2, help="processes of Sphinx")
    arguments = parser.parse_args()
    chosen = arguments.catalogue
    if chosen is None:
        cached = (info.id for info in swarmdata.list_datasets() if info.is_cached)
        chosen = [each for each in cached if "-mini-" in each]
    build(arguments.out, chosen, jobs=arguments.jobs)


if __name__ == "__main__":
    main()
