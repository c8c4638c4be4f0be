"""Makes the notebooks of the tutorials: their Markdown with the outputs of its Python blocks.

python -m docs.site.make_notebooks [NAME]...
"""

import itertools
import os
import re
import sys
import tempfile
import time
import tomllib
from pathlib import Path

from platformdirs import user_cache_path

ROOT = Path(__file__).parents[2]
TUTORIALS = ROOT / "docs/tutorials"
COLAB = "https://colab.research.google.com"
CELL_SECONDS = 1_800
BLOCK = re.compile(r"^```python\n(.*?)^```\n", re.MULTILINE | re.DOTALL)
INSTALL = re.compile(r"pip install ('swarmdata\[[^`\n]*)")


def cells_of(text: str) -> list[tuple[str, str]]:
    """The cells of a tutorial, each `markdown` or `code` and its source."""
    parts = [part.strip() for part in BLOCK.split(text)]  # text and code in turn
    cells = zip(itertools.cycle(("markdown", "code")), parts, strict=False)
    return [(kind, source) for kind, source in cells if source]


def notebook_cells(source: Path) -> list[tuple[str, str]]:
    """The cells of a tutorial's notebook: below the title a badge, then what Colab has to install.

    The owner of the repository and the packages are those that pyproject.toml and the page name.
    """
    text = source.read_text(encoding="utf-8")
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    owner = project["urls"]["Repository"].removeprefix("https://github.com/")
    packages = INSTALL.findall(text)[-1]
    (kind, first), *others = cells_of(text)
    title, _, rest = first.partition("\n\n")
    link = f"{COLAB}/github/{owner}/blob/main/docs/tutorials/{source.stem}.ipynb"
    badge = f"[![Open in Colab]({COLAB}/assets/colab-badge.svg)]({link})"
    install = (
        f'import sys\n\nif "google.colab" in sys.modules:\n    %pip install --quiet {packages}'
    )
    return [(kind, f"{title}\n\n{badge}\n\n{rest}"), ("code", install), *others]


def make_notebook(source: Path) -> Path:
    """Runs a tutorial in an empty folder and cache, and writes its notebook beside it.

    Raises:
        nbclient.exceptions.CellExecutionError: a cell raised an exception.
    """
    import nbformat
    from nbclient import NotebookClient

    notebook = nbformat.v4.new_notebook()
    notebook.metadata["kernelspec"] = {
        "name": "python3", "display_name": "Python 3", "language": "python",
    }  # fmt: skip
    for number, (kind, text) in enumerate(notebook_cells(source)):
        make = nbformat.v4.new_code_cell if kind == "code" else nbformat.v4.new_markdown_cell
        notebook.cells.append(make(text, id=f"{source.stem}-{number}"))
    os.environ.setdefault("NUMBA_CACHE_DIR", str(user_cache_path("swarmdata") / "kernels"))
    with tempfile.TemporaryDirectory() as folder:
        cache, work = Path(folder, "cache"), Path(folder, "tutorial")
        os.environ.update({"SWARMDATA_CACHE": str(cache), "SWARMDATA_REMOTES": ""})
        work.mkdir()
        NotebookClient(
            notebook, timeout=CELL_SECONDS, resources={"metadata": {"path": str(work)}},
            record_timing=False, coalesce_streams=True,
        ).execute()  # fmt: skip
    for cell in notebook.cells:
        cell.metadata.clear()
        if cell.cell_type == "code":  # progress and warnings are no results
            cell.outputs = [o for o in cell.outputs if o.get("name") != "stderr"]
    notebook.metadata.pop("language_info", None)
    target = source.with_suffix(".ipynb")
    text = nbformat.writes(notebook).replace(str(cache), "~/.cache/swarmdata")
    target.write_text(text.replace(str(work), "~/tutorial") + "\n", encoding="utf-8")
    return target


def main() -> None:
    """Makes the named tutorials, or all."""
    for source in sorted(TUTORIALS.glob("*.md")):
        if not sys.argv[1:] or source.stem in sys.argv[1:]:
            start = time.perf_counter()
            target = make_notebook(source)
            sys.stdout.write(f"{target}: {time.perf_counter() - start:.0f} s\n")


if __name__ == "__main__":
    main()
