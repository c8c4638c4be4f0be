"""Pages of questions: the sections of reports that bear on each, below text that stays."""

import re
import shutil
from pathlib import Path

import pytest

from swarmdata.drawing.page_text import MADE
from swarmdata.errors import OutputError, StudyError
from swarmdata.evaluation.study.pages.result_pages import QUESTIONS, STUDY_PAGES, write_result_pages
from swarmdata.evaluation.study.pages.study_folder import rewrite_pages
from swarmdata.runtime.output_folder import filled

ROOT = Path(__file__).parents[4]
STUDIES = ROOT / "cards/studies"


def test_committed_pages_are_what_the_command_writes(tmp_path: Path) -> None:
    (tmp_path / "cards").mkdir()
    (tmp_path / "cards/studies").symlink_to(STUDIES)
    out = Path(shutil.copytree(ROOT / "docs/results", tmp_path / "docs/results"))
    pages, left_out = write_result_pages(tmp_path / "cards/studies", out)
    assert left_out == {}
    assert [page.stem for page in pages] == ["README", *(each.stem for each in QUESTIONS)]
    for page in pages:
        assert page.read_text() == (ROOT / "docs/results" / page.name).read_text(), page.name


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """All pages in a new folder."""
    out = tmp_path_factory.mktemp("pages") / "results"
    write_result_pages(STUDIES, out)
    return out


@pytest.mark.parametrize(
    ("stem", "row"),
    [
        ("ingredients", r"`maddpg_bc` − `maddpg_bc-without` \| "),
        ("training-length", r"cloning \| 18,000 \| "),
        ("data-regimes", r"`iql` \| in-sample \| "),
        ("online", r"`maddpg-coop_nav` \| 5 \| "),
        ("information", r"`bc` \| "),
        ("robustness", r"`bc-gru` \| "),
        ("places", r"`bc` \| .*other inputs"),
        ("data-efficiency", r"coop_nav-expert \| `bc` \| 50,016: "),
        ("safety", r"`maddpg_bc-safe` − |`\S+` − `\S+` \| "),
        ("distance-from-data", r"coop_nav-expert \| `bc` \| "),
    ],
)
def test_a_new_folder_has_the_tables_and_figures_of_each_question(
    made: Path, stem: str, row: str
) -> None:
    page = (made / f"{stem}.md").read_text()
    (question,) = (each for each in QUESTIONS if each.stem == stem)
    assert page.startswith(f"# {question.title}\n\n{MADE}\n\n## Study ")
    assert re.search(rf"\n\| {row}", page)
    links = re.findall(r"\]\(([^)#]+)\)", page)
    assert links
    assert all((made / link).exists() for link in links)
    assert f"- [{question.title}]({stem}.md)\n" in (made / "README.md").read_text()


def test_text_above_the_made_part_stays(tmp_path: Path) -> None:
    out = tmp_path / "results"
    with filled(out, STUDY_PAGES) as folder:
        (folder / "places.md").write_text(f"# Mine\n\nWhere to.\n\n{MADE}\n\nold table\n")
        (folder / "safety.md").write_text("# All by hand\n")
    (out / "notes.png").write_text("mine")
    shutil.copytree(STUDIES / "safe", tmp_path / "studies/safe")
    _, left_out = write_result_pages(tmp_path / "studies", out)
    assert (out / "notes.png").read_text() == "mine"
    page = (out / "safety.md").read_text()
    assert page.startswith(f"# All by hand\n\n{MADE}\n\n## Study safe\n")
    assert left_out["places.md"] == "no study has policies evaluated in other `tasks`"
    page = (out / "places.md").read_text()
    assert page.startswith(f"# Mine\n\nWhere to.\n\n{MADE}\n")
    assert "old table" not in page, "its study is gone"
    assert not (out / "online.md").exists()
    with pytest.raises(StudyError, match=r"no folder of a study with study\.yaml and report\.md"):
        write_result_pages(tmp_path / "results", tmp_path / "new")
    (tmp_path / "theirs").mkdir()
    (tmp_path / "theirs/safety.md").write_text("mine")
    with pytest.raises(OutputError):
        write_result_pages(tmp_path / "studies", tmp_path / "theirs")


def _is_made_again(study: Path, folder: Path) -> None:
    """The report and the estimates of a committed study are what its episodes give."""
    again = Path(shutil.copytree(study, folder / study.name))
    rewrite_pages(again)
    for name in ("report.md", "estimates.csv"):
        assert (again / name).read_text() == (study / name).read_text(), study.name


@pytest.mark.usefixtures("empty_figures")
@pytest.mark.parametrize("study", ["noise", "safe"])
def test_a_committed_report_is_what_its_episodes_give(study: str, tmp_path: Path) -> None:
    _is_made_again(STUDIES / study, tmp_path)


@pytest.mark.slow
@pytest.mark.usefixtures("empty_figures")
@pytest.mark.parametrize("plan", sorted(STUDIES.glob("*/study.yaml")), ids=lambda p: p.parent.name)
def test_every_committed_report_is_what_its_episodes_give(plan: Path, tmp_path: Path) -> None:
    _is_made_again(plan.parent, tmp_path)
