"""Verification without a second interpreter."""

import json
import runpy
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.support.at_once import Forked


def change_metrics(entry: Path, change: Any, *names: str) -> None:
    """Adds to metrics that an entry claims."""
    for file in (entry / "results").iterdir():
        document = json.loads(file.read_text())
        for name in names:
            document["metrics"][name] = list(np.add(document["metrics"][name], change))
        file.write_text(json.dumps(document))


def run_module(name: str, *words: str) -> None:
    """As `python -m` does."""
    sys.argv = [name, *words]
    runpy.run_module(name, run_name="__main__")


@pytest.fixture
def forked(monkeypatch: pytest.MonkeyPatch) -> None:
    """`verify` forks the process instead of starting an interpreter: that takes seconds."""

    def run(command: list[str], **_: object) -> subprocess.CompletedProcess[bytes]:
        assert command[:2] == [sys.executable, "-m"]
        code, out, err = Forked(*command[2:], work=run_module).end()
        return subprocess.CompletedProcess(command, code or 0, out.encode(), err.encode())

    monkeypatch.setattr("swarmdata.evaluation.leaderboard.verify.subprocess.run", run)
