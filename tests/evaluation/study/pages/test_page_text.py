"""Pages keep the text that stands above what a command makes."""

from pathlib import Path

from swarmdata.evaluation.study.pages.study_folder import MADE, page_with


def test_only_what_is_made_is_replaced(tmp_path: Path) -> None:
    file = tmp_path / "page.md"
    file.write_text(page_with("first table", file, "Title"))
    assert file.read_text() == f"# Title\n\n{MADE}\n\nfirst table\n"
    file.write_text(file.read_text().replace("# Title\n", "# Title\n\nBy hand.\n"))
    assert page_with("second", file, "Other") == f"# Title\n\nBy hand.\n\n{MADE}\n\nsecond\n"
    file.write_text("By hand alone.\n")
    assert page_with("second", file, "Other") == f"By hand alone.\n\n{MADE}\n\nsecond\n"
