"""Commands in processes of their own, at the same time."""

import subprocess
import sys
from pathlib import Path

SECONDS = 600
"""For one command on a busy machine."""


def start(*arguments: str | Path) -> "subprocess.Popen[str]":
    """Starts a command of swarmdata."""
    code = "from swarmdata.cli.main import main; main()"
    line = [sys.executable, "-c", code, *map(str, arguments)]
    return subprocess.Popen(line, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def run_at_once(*commands: tuple[str | Path, ...]) -> list[str]:
    """Runs commands at the same time; returns what each one printed."""
    outputs = []
    for process in [start(*command) for command in commands]:
        output, errors = process.communicate(timeout=SECONDS)
        assert process.returncode == 0, errors
        outputs.append(output)
    return outputs
