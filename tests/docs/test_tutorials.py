"""The notebooks are the tutorials with outputs: nothing is edited by hand, and nothing failed."""

import json
import re
from pathlib import Path

import pytest

from docs.site.make_notebooks import TUTORIALS, cells_of, notebook_cells

SOURCES = sorted(TUTORIALS.glob("*.md"))


def test_there_are_tutorials() -> None:
    assert {path.stem for path in SOURCES} == {path.stem for path in TUTORIALS.glob("*.ipynb")}
    assert len(SOURCES) >= 3


def test_notebooks_open_in_colab_and_install_what_their_page_names_there() -> None:
    kinds, texts = zip(*notebook_cells(TUTORIALS / "another-environment.md")[:2], strict=True)
    assert kinds == ("markdown", "code")
    assert "/blob/main/docs/tutorials/another-environment.ipynb)" in texts[0].split("\n\n")[1]
    assert texts[1].endswith("    %pip install --quiet 'swarmdata[torch,plots]' mpe2")


@pytest.mark.parametrize("source", SOURCES, ids=lambda path: path.stem)
def test_the_notebook_is_its_source_and_ran_from_top_to_bottom(source: Path) -> None:
    notebook = json.loads(source.with_suffix(".ipynb").read_text(encoding="utf-8"))
    sources = [(cell["cell_type"], "".join(cell["source"])) for cell in notebook["cells"]]
    assert sources == notebook_cells(source), "run: make notebooks"
    cells = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    assert [cell["execution_count"] for cell in cells] == list(range(1, len(cells) + 1))
    outputs = [output for cell in cells for output in cell["outputs"]]
    assert not [output for output in outputs if output["output_type"] == "error"]
    assert any("image/png" in output.get("data", {}) for output in outputs)
    folders = re.search(r"/(tmp|home|root|var)/", json.dumps(outputs))
    assert not folders, "of the machine that made it"


def test_text_and_code_alternate() -> None:
    text = "# A\n\nWords.\n\n```python\na = 1\n\nb = 2\n```\n\nMore.\n\n    a command\n"
    assert cells_of(text) == [
        ("markdown", "# A\n\nWords."),
        ("code", "a = 1\n\nb = 2"),
        ("markdown", "More.\n\n    a command"),
    ]
