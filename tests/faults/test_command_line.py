"""What a shell does to a command: closed pipes, full files, names that no system takes."""

import json
import logging
import os
import subprocess
import sys
import traceback
import warnings
from pathlib import Path

import pytest
from typer.testing import CliRunner

from swarmdata.cli.main import app, main
from swarmdata.errors import (
    MOST_QUOTED,
    DatasetNotFoundError,
    HubError,
    ManifestError,
    SpecError,
    SwarmdataError,
    UnknownNameError,
    quoted,
)
from swarmdata.evaluation.results.policy_names import find_target
from swarmdata.hub.catalog.catalog import find_folder, load
from swarmdata.store import read_manifest
from swarmdata.testing.synthetic import make_dataset
from tests.support.pairs import slow
from tests.support.tiny import sign

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


@pytest.mark.parametrize("command", [*slow("list"), "--help"])
def test_a_closed_pipe_ends_a_command_like_any_other(command: str) -> None:
    """Row 65: `swarmdata list | head` says nothing, and has the exit code of SIGPIPE."""
    assert shell(f"swarmdata {command} | true") == (141, "", "")


def test_the_first_line_is_there() -> None:
    """Row 65: what was read before."""
    code, out, err = shell("swarmdata list | head -1")
    assert out.startswith("id ")
    assert (code in (0, 141), err) == (True, "")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs the device /dev/full")
@pytest.mark.parametrize("command", [*slow("list"), "--help"])
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


HOSTILE = "a\x1b[2J\x07b\r\x9b\u202ec https://me:s3cret@host/x?sig=s3cret"
"""Clears a screen, rings, overwrites its line, turns text around, and names two secrets."""


def is_harmless(text: str) -> bool:
    return "s3cret" not in text and all(each.isprintable() or each in "\n\t" for each in text)


def test_what_others_wrote_is_one_short_line() -> None:
    """Row 80: of servers, files and libraries, as messages repeat it."""
    assert is_harmless(quoted(HOSTILE))
    assert quoted("two\n  lines") == "two lines"
    assert len(quoted("x" * 10_000)) == MOST_QUOTED + 1
    assert quoted("Zürich, 東京") == "Zürich, 東京"


@pytest.mark.parametrize("kind", [HubError, UnknownNameError, SpecError])
def test_no_error_controls_a_terminal(kind: type[SwarmdataError]) -> None:
    """Row 80: whatever the message was made of, and whoever shows it."""
    error = kind("name", HOSTILE, []) if kind is UnknownNameError else kind(HOSTILE)
    assert is_harmless(str(error))
    assert is_harmless("".join(traceback.format_exception_only(error)))


def test_nor_does_a_command(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Row 80: in warnings, notes and errors of the system, too."""

    def hostile() -> list[object]:
        logging.getLogger("swarmdata").warning(HOSTILE)
        raise OSError(5, HOSTILE, HOSTILE)

    monkeypatch.setattr("swarmdata.hub.catalog.listing.list_datasets", hostile)
    monkeypatch.setattr("sys.argv", ["swarmdata", "list"])
    monkeypatch.setattr(warnings, "formatwarning", warnings.formatwarning)
    with pytest.raises(SystemExit) as caught:
        main()
    assert is_harmless(warnings.formatwarning(HOSTILE, UserWarning, "file", 1))
    shown = capsys.readouterr().err
    assert caught.value.code == 1
    assert shown.count("\\x1b[2J") >= 2
    assert is_harmless(shown)


@pytest.mark.parametrize("section", ["id", "files", "provenance"])
def test_nor_does_a_manifest(tmp_path: Path, section: str) -> None:
    """Row 80: what it names is printed by many commands, so it is refused where it is read."""
    make_dataset(tmp_path / "d", [[3] * 10])
    content = json.loads((tmp_path / "d" / "manifest.json").read_bytes())
    found = content[section]
    entry = next(iter(found.values())) if isinstance(found, dict) else None
    content[section] = HOSTILE if entry is None else {**found, HOSTILE: entry}
    sign(tmp_path / "d", content)
    with pytest.raises(ManifestError, match="all printable") as caught:
        read_manifest(tmp_path / "d")
    assert is_harmless(str(caught.value))
