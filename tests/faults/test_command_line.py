"""What a shell does to a command: closed pipes, full files, names that no system takes."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from swarmdata.cli.main import app
from swarmdata.errors import DatasetNotFoundError, UnknownNameError
from swarmdata.evaluation.results.policy_names import find_target
from swarmdata.hub.catalog.catalog import find_folder, load

LONG = "x" * 300


def shell(command: str) -> tuple[int, str, str]:
    """Runs a pipeline in bash, where `swarmdata` is ours; code of the first program, outputs."""
    script = f"import sys; sys.path[:] = {sys.path!r}; from swarmdata.cli.main import main; main()"
    ours = 'swarmdata() { "$PYTHON" -c "$SCRIPT" "$@"; }'
    found = subprocess.run(
        ["bash", "-c", f"{ours}; {command}; exit ${{PIPESTATUS[0]}}"],
        env={**os.environ, "PYTHON": sys.executable, "SCRIPT": script},
        capture_output=True, text=True, check=False, timeout=300,
    )  # fmt: skip
    return found.returncode, found.stdout, found.stderr


@pytest.mark.parametrize("command", ["list", "registry list", "--help"])
def test_a_closed_pipe_ends_a_command_like_any_other(command: str) -> None:
    """Row 65: `swarmdata list | head` says nothing, and has the exit code of SIGPIPE."""
    assert shell(f"swarmdata {command} | true") == (141, "", "")


def test_the_first_line_is_there() -> None:
    """Row 65: what was read before."""
    code, out, err = shell("swarmdata list | head -1")
    assert out.startswith("id ")
    assert (code in (0, 141), err) == (True, "")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs the device /dev/full")
@pytest.mark.parametrize("command", ["list", "--help"])
def test_a_full_disk_behind_the_output_is_one_line(command: str) -> None:
    """Row 65: and no traceback of Python's end."""
    code, _, err = shell(f"swarmdata {command} > /dev/full")
    assert code == 1
    assert err.count("\n") == 1
    assert "No space left on device" in err


def test_a_name_of_300_characters_is_an_unknown_one() -> None:
    """Row 66: not an OSError of the file system."""
    for use in (load, find_folder, find_target):
        with pytest.raises(UnknownNameError, match="unknown"):
            use(LONG)


@pytest.mark.parametrize(
    "command",
    [
        ["info"], ["verify"], ["card"], ["audit"], ["convert", "x", "--to", "d4rl"],
        ["render", "--out", "x.png"], ["evaluate", "--out", "x"], ["train", "--out", "x", "bc"],
        ["push", "file:///tmp"], ["pull"], ["task", "show"], ["report", "--out", "x"], ["study"],
    ],
    ids=lambda words: " ".join(words[:2]),
)  # fmt: skip
def test_every_command_says_so_in_one_line(command: list[str], tmp_path: Path) -> None:
    """Row 66: whatever a name of 300 characters is given to."""
    first = 2 if command[0] == "task" else 1
    words = [*command[:first], LONG, *command[first:]]
    if command[0] == "train":
        words = [*command, LONG]
    found = CliRunner().invoke(app, words)
    assert found.exit_code in (1, 2), found.output
    assert isinstance(found.exception, SystemExit)
    assert found.output.count("\n") == 1
    assert "Error: " in found.output


@pytest.mark.parametrize("inside", ["", "deep/inside"])
def test_a_cache_that_is_a_dangling_link(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, inside: str
) -> None:
    """Row 67: the link and its target are named, and nothing is made."""
    (tmp_path / "cache").symlink_to(tmp_path / "unmounted")
    monkeypatch.setenv("SWARMDATA_CACHE", str(tmp_path / "cache" / inside))
    for name in ("coop_nav-random-mini", "lab-other-v3"):
        with pytest.raises(DatasetNotFoundError, match=r"is a symbolic link to .*unmounted, which"):
            load(name)
    found = CliRunner().invoke(app, ["list"])
    assert (found.exit_code, "set SWARMDATA_CACHE to another" in found.output) == (1, True)
    assert [path.name for path in tmp_path.iterdir()] == ["cache"]
    (tmp_path / "unmounted").mkdir()
    assert CliRunner().invoke(app, ["list"]).exit_code == 0
