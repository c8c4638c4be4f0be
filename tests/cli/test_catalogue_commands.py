"""`swarmdata catalogue`: what it writes, prints, opens and refuses."""

import webbrowser
from pathlib import Path

import pytest
from typer.testing import CliRunner

from swarmdata.cli.main import app
from tests.catalogue.conftest import little_published
from tests.support.command_line import run
from tests.support.tiny import TINY


def test_build_and_open(tiny: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out = tmp_path / "site"
    opened: list[str] = []

    def show(address: str) -> bool:
        opened.append(address)
        return True

    monkeypatch.setattr(webbrowser, "open", show)

    with little_published():
        built = CliRunner().invoke(app, ["catalogue", "build", str(tiny), "--out", str(out)])
    shown = run("catalogue", "open", "--out", out)

    assert built.exit_code == 0, built.output
    assert f"{TINY.id}: " in built.stderr
    assert built.stdout.strip() == str(out / "index.html")
    assert [page.stem for page in (out / "datasets").iterdir()] == [TINY.id]
    assert not (out / "results").exists(), "no committed study has results on it"
    assert opened == [(out / "index.html").as_uri()]
    assert shown.strip() == opened[0]


def test_without_a_browser_the_address_is_printed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "catalogue.json").write_text('{"format": "swarmdata-catalogue", "files": ["a"]}')
    monkeypatch.setattr(webbrowser, "open", lambda address: False)

    assert "open this address" in run("catalogue", "open", "--out", tmp_path)


def test_open_says_how_to_build(tmp_path: Path) -> None:
    assert "swarmdata catalogue build" in run("catalogue", "open", "--out", tmp_path, code=1)
