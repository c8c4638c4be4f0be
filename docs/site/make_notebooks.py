"""Makes the notebooks of the tutorials: the Markdown with the outputs of its Python blocks.

    python -m docs.site.make_notebooks [NAME]...

`docs/tutorials/NAME.md` is the source; nobody edits `NAME.ipynb`. Every tutorial runs in an empty
folder with an empty cache of datasets, so that nothing that lies around decides its outputs. Where
an output names that cache, the notebook has the usual one: the same run gives the same file.
"""

import os
import re
import sys
import tempfile
import time
import tomllib
from pathlib import Path
from typing import Any

from platformdirs import user_cache_path

ROOT = Path(__file__).parents[2]
TUTORIALS = ROOT / "docs/tutorials"
COLAB = "https://colab.research.google.com"
CELL_SECONDS = 1_800
BLOCK = re.compile(r"^```python\n(.*?)^```\n", re.MULTILINE | re.DOTALL)
INSTALL = re.compile(r"pip install ('swarmdata\[[^`\n]*)")


def cells_of(text: str) -> list[tuple[str, str]]:
    """The cells of a tutorial, each `markdown` or `code` and its source."""
    cells, end = [], 0
    for block in BLOCK.finditer(text):
        cells += [("markdown", text[end : block.start()].strip()), ("code", block[1].rstrip())]
        end = block.end()
    cells.append(("markdown", text[end:].strip()))
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


def source_of(notebook: Any) -> list[tuple[str, str]]:
    """The cells of a notebook, without outputs."""
    return [(cell["cell_type"], "".join(cell["source"])) for cell in notebook["cells"]]


def make_notebook(source: Path) -> Path:
    """Runs a tutorial, and writes its notebook beside it.

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
    kernels = str(user_cache_path("swarmdata") / "kernels")
    with tempfile.TemporaryDirectory() as folder:
        settings = {"SWARMDATA_CACHE": str(Path(folder, "cache")), "SWARMDATA_REMOTES": ""}
        os.environ.update(
            {"NUMBA_CACHE_DIR": os.environ.get("NUMBA_CACHE_DIR", kernels), **settings}
        )
        work = Path(folder, "tutorial")
        work.mkdir()
        NotebookClient(
            notebook, timeout=CELL_SECONDS, resources={"metadata": {"path": str(work)}},
            record_timing=False,
        ).execute()  # fmt: skip
    for cell in notebook.cells:
        cell.metadata.clear()
        if cell.cell_type == "code":  # progress and warnings are no results
            cell.outputs = [o for o in cell.outputs if o.get("name") != "stderr"]
    notebook.metadata.pop("language_info", None)
    target = source.with_suffix(".ipynb")
    written = nbformat.writes(notebook).replace(settings["SWARMDATA_CACHE"], "~/.cache/swarmdata")
    written = written.replace(str(work), "~/tutorial")
    target.write_text(written + "\n", encoding="utf-8")
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
