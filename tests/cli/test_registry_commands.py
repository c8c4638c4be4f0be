"""`swarmdata registry`: what it prints, what it writes, and its exit codes."""

import json
from functools import partial
from pathlib import Path

import pytest

from swarmdata.hub.publishing import regenerate
from swarmdata.registry import published, recipes
from swarmdata.registry.published import Published
from tests.support import command_line, tiny

pytestmark = pytest.mark.usefixtures("one_process")

TINY = tiny.TINY.model_copy(update={"id": "coop_nav-tiny-mini-v0"})


run = partial(command_line.run, "registry")


@pytest.fixture
def file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The file of what is published, of a package that ships one tiny recipe."""
    path = tmp_path / "published.json"

    def read_file() -> dict[str, Published]:
        return {key: Published.parse(value) for key, value in json.loads(path.read_text()).items()}

    for module in (recipes, regenerate):
        monkeypatch.setattr(module, "find_recipe", lambda name: TINY)
        monkeypatch.setattr(module, "shipped_recipes", lambda: {TINY.id: TINY})
    monkeypatch.setattr(regenerate, "is_dataset", lambda name: True)
    for module in (published, regenerate):
        monkeypatch.setattr(module, "published", read_file)
    path.write_text("{}")
    return path


def test_update_check_and_list(file: Path) -> None:
    (listed,) = [line for line in run("list").splitlines() if "not published" in line]
    assert listed.split() == ["coop_nav-tiny-mini-v0", "not", "published"]
    assert "0 datasets checked" in run("check")
    output = run("update", "--id", "coop_nav-tiny-mini", "--out", file, "--workers", "1")
    entry = json.loads(file.read_text())[TINY.id]

    assert f"digest {entry['digest']}" in output
    assert "of another recipe" not in run("list")
    assert entry["transport_digest"][:12] in run("list")
    assert f"{TINY.id}: as published" in run("check", "--minis", "--workers", "1")

    entry |= {"mean_return": 1.5, "recipe_hash": "0" * 64}
    file.write_text(json.dumps({TINY.id: entry}))
    output = run("check", "--id", "coop_nav-tiny-mini", "--workers", "1", code=1)
    assert f"{TINY.id}: 2 differences" in output
    assert f"{TINY.id}  mean_return  1.5" in output
    assert "of another recipe" in run("list")


def test_an_unpublished_id_is_an_error(file: Path) -> None:
    assert "unknown published dataset" in run("check", "--id", "coop_nav-tiny", code=1)
