"""Settings of Sphinx for the site; `docs/site/build_site.py` runs it on a tree of staged pages."""

import re
from typing import Any

import swarmdata

project = "swarmdata"
author = copyright = "The swarmdata contributors"
version = release = swarmdata.__version__

extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
suppress_warnings = ["mystnb.mime_priority"]
root_doc = "index"
exclude_patterns = ["**.ipynb_checkpoints"]
highlight_language = "none"  # of indented blocks: commands, formulas and YAML
pygments_style = "default"
pygments_dark_style = "github-dark"

myst_heading_anchors = 4  # as GitHub makes them
myst_enable_extensions = ["html_image"]
myst_links_external_new_tab = False
nb_execution_mode = "off"  # notebooks have their outputs: docs/site/make_notebooks.py

autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
default_role = "code"  # docstrings write code in single backticks, as Markdown does
maximum_signature_line_length = 90
python_use_unqualified_type_names = True
add_module_names = False
napoleon_numpy_docstring = False
napoleon_use_rtype = False

html_theme = "furo"
html_title = f"swarmdata {release}"
html_static_path = ["assets"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sphinx = False
html_show_copyright = False
html_theme_options = {"navigation_with_keys": True, "top_of_page_buttons": []}


def setup(app: Any) -> None:
    """Reads docstrings as they are written: indented blocks are code, lists need no blank line."""
    app.connect("autodoc-process-docstring", _as_restructured_text, priority=400)
    app.connect("autodoc-process-signature", _without_fields)


def _without_fields(app: Any, what: str, name: str, found: Any, *_: Any) -> tuple[str, None] | None:
    """Leaves out the constructor of a pydantic model, which repeats all fields and validators."""
    return ("", None) if what == "class" and hasattr(found, "model_fields") else None


def _as_restructured_text(*event: Any) -> None:
    what, lines = event[1], event[-1]
    if what in ("attribute", "property") and lines:  # else the words before a colon were a type
        lines[:1] = lines[0].replace(": ", ":\n", 1).split("\n")
    found: list[str] = []
    for place, line in enumerate(lines):
        before = lines[place - 1] if place else ""
        opens_code = line.startswith("    ") and not before.strip() and not _is_indented(found)
        if opens_code and not line.lstrip().startswith(">>>"):
            found += ["::", ""]
        if line.startswith("- ") and before.strip() and not before.startswith(("- ", "  ")):
            found.append("")
        found.append(
            line
            if line.startswith("    ")
            else re.sub(r"\|(?=[^`]*(?:`[^`]*`[^`]*)*$)", r"\|", line)
        )
    lines[:] = found


def _is_indented(lines: list[str]) -> bool:
    """Whether the last line with text is indented, as within a block or a section."""
    last = next((line for line in reversed(lines) if line.strip()), "")
    return last.startswith("    ") or last == "::"
