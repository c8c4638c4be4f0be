"""`swarmdata audit`: what it prints, and its exit codes."""

import json
import shutil
from pathlib import Path

import pytest

from swarmdata.store.arrays.layout import CARD
from tests.support.command_line import run


def test_clean(dataset: Path) -> None:
    result = run("audit", str(dataset))
    assert result.startswith("coop_nav-small-v0 (digest ")
    assert result.endswith("checks, no problems\n")


def test_an_id_in_the_cache_with_problems(dataset: Path, cache_folder: Path) -> None:
    folder = cache_folder / "datasets" / dataset.name
    shutil.copytree(dataset, folder)
    (folder / CARD).write_text("typed by hand")
    result = run("audit", dataset.name, "--sample", "0", code=1)
    assert "problem: card: line 1 of card.md is 'typed by hand'" in result
    assert "note: replay: no episodes were replayed, as requested" in result
    content = json.loads(run("audit", dataset.name, "--json", code=1))
    assert content["n_problems"] == 1
    assert content["findings"][0]["check"] == "card"


@pytest.mark.parametrize("name", ["coop_nav-random-mini", "coop_nav-nothing"])
def test_what_cannot_be_read(name: str, tmp_path: Path) -> None:
    assert "there is no dataset at" in run("audit", tmp_path, code=2)
    shown = run("audit", name, code=2)
    assert "Get it with: swarmdata generate" in shown or "Did you mean" in shown
