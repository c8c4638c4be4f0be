"""Every command that writes to a folder leaves the files of others alone, and says so at once.

The inputs of the commands do not exist: a message about the folder shows that it came first.
"""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer
from typer.testing import CliRunner, Result

from swarmdata.cli.main import app
from tests.support.tiny import TINY

FOLDERS = {
    "card": "nothing",
    "catalogue build": "nothing",
    "combine": "{tiny} --id coop_nav-some-v0",
    "convert": "{plan} {out} --from d4rl --id coop_nav-some-v0",
    "evaluate": "random --episodes 1",
    "fetch": "turtles --accept-terms --from nothing",
    "filter": "{tiny} --id coop_nav-some-v0",
    "generate": "coop_nav-random-mini",
    "import": "nothing --map mrclam --id hall-monday-v0",
    "leaderboard submit": "nothing --dataset coop_nav-random --name a --license b --code c "
    "--trials 1 --tuning-episodes 0",
    "pull": "{shelf}/" + TINY.id,
    "rank": "nothing",
    "report": "nothing",
    "ship": "coop_nav",
    "study": "{plan}",
    "subsample": "{tiny} --id coop_nav-some-v0 --steps 100",
    "sweep": "expert --observation noise=0..0.1",
    "task table": "",
    "train": "bc nothing",
    "train-online": "mappo coop_nav",
    "tune": "bc nothing",
}
"""Arguments of the commands that write to a folder."""

FILES = {"fit", "references", "registry update", "render", "task play"}
"""Commands whose `--out` names the one file that they write, or that they update."""

READERS = {"catalogue open"}

WITH_TORCH = {"leaderboard submit", "rank", "ship", "study", "train", "train-online", "tune"}
"""Commands that ask for torch before they look at folders."""

PLANTED = {
    **dict.fromkeys(("notes.txt", "report.md", "README.md", "results/notes.txt"), "mine"),
    **dict.fromkeys(("table.csv", "losses.csv", "curve.csv", "sweep.csv", "ranking.json"), "mine"),
    ".git/HEAD": "ref: refs/heads/main",
    "data.zarr/zarr.json": "{}",
}
"""A folder of somebody; some files have names that a command gives."""

RUNNER = CliRunner()

pytestmark = pytest.mark.usefixtures("one_process")


def commands(group: Any, before: str = "") -> Iterator[tuple[str, Any]]:
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from commands(command, f"{before}{name} ")
        else:
            yield before + name, command


def test_every_command_with_an_out_is_here() -> None:
    whole = typer.main.get_command(app)
    found = {
        name
        for name, command in commands(whole)
        if any("--out" in option.opts for option in command.params)
    }
    assert found == ({*FOLDERS, *FILES, *READERS} - {"convert", "train --task"})


def planted(folder: Path) -> Path:
    for name, text in PLANTED.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    return folder


def content(folder: Path) -> dict[str, str]:
    return {
        path.relative_to(folder).as_posix(): path.read_text()
        for path in folder.rglob("*")
        if path.is_file()
    }


@pytest.fixture(scope="module")
def shelf(tmp_path_factory: pytest.TempPathFactory, tiny: Path) -> str:
    from tests.support.tiny import Shelf

    return Shelf(tmp_path_factory.mktemp("remote") / "shelf", tiny).address


def run(name: str, out: Path, tiny: Path, shelf: str, plan: Path) -> Result:
    if name in WITH_TORCH:
        pytest.importorskip("torch")
    plan.write_text("name: own\nalgorithms: [bc]\ndatasets: [coop_nav-nothing]\n")
    words = {"tiny": str(tiny), "shelf": shelf, "plan": str(plan), "out": str(out)}
    arguments = [each.format(**words) for each in FOLDERS[name].split()]
    where = [] if name == "convert" else ["--out", str(out)]
    return RUNNER.invoke(app, [*name.split(), *arguments, *where])


@pytest.mark.parametrize("name", FOLDERS)
def test_a_folder_of_somebody_is_refused_before_any_work(
    name: str, tiny: Path, shelf: str, tmp_path: Path
) -> None:
    """Row 77: reports replaced ten files by name, a training wrote its losses over others."""
    out = planted(tmp_path / "outer" / "thesis")
    result = run(name, out, tiny, shelf, tmp_path / "plan.yaml")
    assert result.exit_code == 1, result.output
    assert str(out) in result.stderr
    assert result.stderr.count("\n") == 1, result.stderr
    assert content(out) == PLANTED
    assert [path.name for path in out.parent.iterdir()] == ["thesis"], "nothing is beside it"


@pytest.mark.parametrize("name", sorted(set(FOLDERS) - {"pull", "convert"}))
def test_a_folder_of_another_kind_is_refused(
    name: str, tiny: Path, shelf: str, tmp_path: Path
) -> None:
    """Row 77: a list of what another command wrote, or somebody else, is no licence."""
    out = tmp_path / "outer" / "other"
    out.mkdir(parents=True)
    content_of_list = {"format": "swarmdata-other", "format_version": 2, "files": ["report.md"]}
    (out / ".swarmdata-files.json").write_text(json.dumps(content_of_list))
    (out / "report.md").write_text("mine")
    before = content(out)
    result = run(name, out, tiny, shelf, tmp_path / "plan.yaml")
    assert result.exit_code == 1, result.output
    assert str(out) in result.stderr
    assert content(out) == before
