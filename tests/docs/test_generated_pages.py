"""Whatever is registered has a page, whatever is public is in the reference, and links work."""

import json
import re
from pathlib import Path

import pytest

pytest.importorskip("torch", reason="algorithms need torch")

import swarmdata
from docs.site.api_pages import GROUPS, api_pages
from docs.site.build_site import broken_links, generated_pages, stage
from docs.site.schema_pages import SCHEMAS, models
from docs.site.staged_pages import BrokenLinkError, site_path, staged_text
from swarmdata.interop.formats import FORMATS
from swarmdata.registry.components import OFFLINE_ALGORITHMS, ONLINE_ALGORITHMS, TASKS
from swarmdata.registry.presets import preset, preset_names
from swarmdata.registry.published import published

FENCED = re.compile(r"^( *)(```+|~~~+).*?^ *\2 *$", re.MULTILINE | re.DOTALL)
HEADING = re.compile(r"^(#{1,6}) ", re.MULTILINE)


@pytest.fixture(scope="module")
def pages() -> dict[str, str]:
    return generated_pages()


@pytest.fixture(scope="module")
def tree(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("pages")
    stage(folder, has_catalogue=True)
    return folder


@pytest.mark.slow
def test_everything_registered_has_a_page(pages: dict[str, str], tree: Path) -> None:
    reference = "reference/"
    expected = {
        *(f"{reference}tasks/{name}.md" for name in TASKS),
        *(f"{reference}presets/{name}.md" for name in preset_names()),
        *(f"{reference}algorithms/{name}.md" for name in OFFLINE_ALGORITHMS),
        *(f"{reference}algorithms/online-{name}.md" for name in ONLINE_ALGORITHMS),
        *(f"{reference}formats/{name}.md" for name in FORMATS),
        *(f"{reference}schemas/{name}.md" for name in SCHEMAS),
    }
    assert expected <= set(pages)
    for name in published():
        assert (tree / f"cards/published/{name}.md").exists()
        assert f"]({name}.md)" in pages["cards/published/index.md"]


def test_every_public_name_is_in_the_reference_once() -> None:
    names = [name for _, group in GROUPS.values() for name in group]
    assert sorted(names) == swarmdata.__all__


@pytest.mark.parametrize("name", SCHEMAS)
def test_every_field_of_a_file_is_on_its_page_with_a_meaning(
    name: str, pages: dict[str, str]
) -> None:
    text = pages[f"reference/schemas/{name}.md"]
    sections = re.findall(r"^## (\w+)$", text, re.MULTILINE)
    assert SCHEMAS[name][1].__name__ == sections[0]
    for section in sections:
        for field in models()[section].model_fields:
            assert f"| `{field}` |" in text, f"{section}.{field}"
    fields = re.findall(r"^\| (`\w+`) \| .+ \| .*? \| (.*?) \|$", text, re.M)
    assert [field for field, meaning in fields if not meaning] == []


def test_ranges_and_comments_reach_the_schema(pages: dict[str, str]) -> None:
    task = pages["reference/schemas/task.md"]
    assert "| `max_speed` | number, 0.001 to 100 | `0.6` | m/s |" in task
    assert "| `sensor_range` | number, 0.001 to 1,000 or none | none | m, of this robot's" in task
    assert "| `dynamics` | `holonomic`, `unicycle` | `holonomic` | a unicycle" in task
    assert "| `id` | text, of the form `" in pages["reference/schemas/recipe.md"]


@pytest.mark.parametrize("task", TASKS)
def test_every_column_of_a_task_is_on_its_page(task: str, pages: dict[str, str]) -> None:
    text = pages[f"reference/tasks/{task}.md"]
    first = preset(task).agent_names[0]
    for row in ("| 0 | `own.x` | own position | m |", f"| 0 | `{first}.x` |", "`robot_onsets`"):
        assert row in text


def test_settings_have_their_defaults(pages: dict[str, str]) -> None:
    assert "| `expectile` | `0.7` | tau, Kostrikov" in pages["reference/algorithms/iql.md"]
    assert "| `shaping." in pages["reference/algorithms/online-mappo.md"]


@pytest.mark.slow
def test_links_of_staged_pages_lead_somewhere(tree: Path) -> None:
    link = re.compile(r"(?:\]\(|src=\")([^)\"\s#:]+)(?:#[^)\s]*)?[)\"]")
    texts = {page: page.read_text(encoding="utf-8") for page in tree.rglob("*.md")}
    for page in tree.rglob("*.ipynb"):
        cells = json.loads(page.read_text(encoding="utf-8"))["cells"]
        texts[page] = "".join("".join(c["source"]) for c in cells if c["cell_type"] == "markdown")
    for page, text in texts.items():
        for target in link.findall(re.sub(r"^```.*?^```", "", text, flags=re.M | re.S)):
            assert (page.parent / target).exists(), f"{page.relative_to(tree)}: {target}"


@pytest.mark.slow
def test_the_sidebar_has_six_parts_with_every_page_of_users(tree: Path) -> None:
    home = (tree / "index.md").read_text(encoding="utf-8")
    parts = re.findall(r"^:caption: (.+)$", home, re.MULTILINE)
    assert parts == ["Start", "Datasets", "Tasks", "Learn", "Results", "Reference"]
    assert not (tree / "docs/fault-tests.md").exists()
    assert not (tree / "docs/worlds").exists()
    for page in [*(tree / "docs").glob("*.md"), *(tree / "docs/tutorials").glob("*.ipynb")]:
        name = page.relative_to(tree).with_suffix("").as_posix()
        assert name in ("docs/index", "docs/measurements") or f"<{name}>" in home, name


def test_headings_go_down_one_level_at_a_time(tree: Path) -> None:
    """Sphinx refuses a page whose headings skip a level."""
    skipped = []
    for page in tree.rglob("*.md"):
        text = FENCED.sub("", page.read_text(encoding="utf-8"))
        levels = [len(marks) for marks in HEADING.findall(text)]
        steps = zip([0, *levels], levels, strict=False)
        if any(level > before + 1 for before, level in steps):
            skipped.append(page.relative_to(tree).as_posix())
    assert skipped == []


def test_a_readme_is_the_index_of_its_folder() -> None:
    assert site_path("docs/results/README.md") == "docs/results/index.md"
    assert site_path("docs/results") == "docs/results/index.md"
    assert site_path("docs/tutorials/own-task.md") == "docs/tutorials/own-task.ipynb"
    assert site_path("docs/worlds/README.md") == "reference/presets/index.md"
    assert site_path("LICENSE") == "LICENSE"
    text, linked = staged_text("docs/tiers.md", "[a](../README.md#datasets) `[b](c)`\n", {})
    assert text.endswith("[a](../index.md#datasets) `[b](c)`\n")
    assert linked == {"README.md"}


def test_a_broken_link_is_refused() -> None:
    with pytest.raises(BrokenLinkError, match=r"docs/tiers.md links to no.md: there is no such"):
        staged_text("docs/tiers.md", "[a](no.md)\n", {})


def test_broken_links_of_a_built_site_are_found(tmp_path: Path) -> None:
    (tmp_path / "a.html").write_text(
        '<p id="x"><a href="#x"></a><a class="y" href="b.html"></a><a href="a.html#z"></a>'
        '<a href="a.html#dataset=z&amp;group=all"></a><a href="c.html#dataset=z"></a>'
        '<a href="https://example.org"></a><img src="a.html">'
    )
    assert sorted(broken_links(tmp_path)) == [
        "a.html: a.html#z",
        "a.html: b.html",
        "a.html: c.html#dataset=z",
    ]


@pytest.mark.slow
def test_the_site_builds_without_a_warning(tmp_path: Path) -> None:
    pytest.importorskip("sphinx", reason="the site needs the dependency group docs")
    pytest.importorskip("furo", reason="the site needs the dependency group docs")
    from docs.site.build_site import build

    build(tmp_path / "site", ["coop_nav-medium-replay-mini"], jobs=2)
    home = (tmp_path / "site/index.html").read_text(encoding="utf-8")
    assert "reference/api/index.html" in home
    pages = (tmp_path / "site").rglob("*.html")
    outside = [
        page
        for page in pages
        if re.search(r"<(?:script|link)[^>]+(?:src|href)=\"https?:", page.read_text())
    ]
    assert outside == [], "a page needs the network"


def test_views_have_what_all_of_them_share() -> None:
    pages = "".join(api_pages().values())
    for name in ("Dataset", "StreamedDataset"):
        directive = pages.partition(f":: swarmdata.{name}\n")[2].partition("```")[0]
        assert ":inherited-members:" in directive
