"""Runs commands that need the core dependencies only, and commands that name what they lack.

    python core_commands.py FOLDER [--long]

It needs nothing but swarmdata, so it also runs where neither pytest nor this repository is at hand.
"""

import os
import sys
from pathlib import Path

ID = "coop_nav-core-v0"
DATA = ("--task", "coop_nav", "--steps", "320", "--policy", "straight", "--policy", "random")

COMMANDS = (
    ("--help",),
    ("--version",),
    ("list",),
    ("info", "coop_nav-medium-mini"),
    ("task", "list"),
    ("task", "show", "transport"),
    ("registry", "list"),
    ("remote", "list"),
    ("generate", *DATA, "--id", ID, "--workers", "1"),
    ("verify", ID, "--replay", "1"),
    ("audit", ID, "--sample", "1"),
    ("card", ID),
    ("filter", ID, "--policy", "straight", "--id", "coop_nav-core-part-v0"),
    ("filter", ID, "--policy", "random", "--id", "coop_nav-core-rest-v0"),
    ("combine", "coop_nav-core-part-v0", "coop_nav-core-rest-v0", "--id", "coop_nav-core-both-v0"),
    ("subsample", ID, "--steps", "100", "--id", "coop_nav-core-small-v0"),
    ("convert", ID, "core.hdf5", "--to", "d4rl"),
    ("evaluate", "straight", ID, "--episodes", "4", "--out", "results"),
)
"""Exit code 0 with the core alone."""

LONG_COMMANDS = (("catalogue", "build", ID, "--out", "site"),)
"""The same, with `--long` only: it writes hundreds of pages."""

EXTRAS = {
    ("train", "bc", ID): "torch",
    ("report", "results", "--out", "report"): "plots",
    ("render", "straight", "--out", "episode.gif"): "plots",
    ("convert", ID, "core.parquet", "--to", "parquet"): "parquet",
    ("convert", ID, "core", "--to", "minari"): "minari",
    ("evaluate", "straight", "--backend", "mujoco", "--episodes", "1"): "mujoco",
    ("pull", "s3://bucket/coop_nav-medium-mini-v1"): "s3",
}
"""Exit code 1 and the sentence that says what to install."""


def run(folder: Path, *, long: bool) -> list[str]:
    """Runs the commands in a folder and returns a line for each that did something else."""
    os.environ["SWARMDATA_CACHE"] = str(folder / "cache")
    os.environ["SWARMDATA_REMOTES"] = ""
    os.chdir(folder)
    from typer.testing import CliRunner

    from swarmdata.cli.main import app

    failures = []
    for command in (*COMMANDS, *(LONG_COMMANDS if long else ()), *EXTRAS):
        found = CliRunner().invoke(app, list(command))
        extra = EXTRAS.get(command)
        code, words = (0, "") if extra is None else (1, f"pip install 'swarmdata[{extra}]'")
        if found.exit_code != code or words not in found.output:
            said = found.output or repr(found.exception)
            failures.append(f"swarmdata {' '.join(command)}: exit code {found.exit_code}: {said}")
    return failures


if __name__ == "__main__":
    failures = run(Path(sys.argv[1]).resolve(), long="--long" in sys.argv)
    sys.exit("\n".join(failures) or 0)
