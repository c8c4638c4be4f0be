"""Programs in an interpreter of their own."""

import subprocess
import sys
from typing import Any


def python(
    *words: object, check: bool = True, **options: Any
) -> "subprocess.CompletedProcess[str]":
    """Runs an interpreter with some arguments, such as `-c` and a program, and keeps what it says.

    `check` and `options` are those of `subprocess.run`.
    """
    command = [sys.executable, *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, check=check, **options)
