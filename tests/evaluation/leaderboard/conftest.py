"""Verification without a second interpreter."""

import json
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.support.at_once import Forked


def change_returns(entry: Path, change: Any) -> None:
    """Adds to the returns that an entry says."""
    for file in (entry / "results").iterdir():
        document = json.loads(file.read_text())
        document["metrics"]["return"] = list(np.add(document["metrics"]["return"], change))
        file.write_text(json.dumps(document))


def act_again(entry: str, out: str, n_episodes: str, n_threads: str) -> None:
    """What `verify` starts."""
    from swarmdata.evaluation.leaderboard.act_again import main

    main(Path(entry), Path(out), int(n_episodes), int(n_threads))


@pytest.fixture
def forked(monkeypatch: pytest.MonkeyPatch) -> None:
    """`verify` forks the process instead of starting an interpreter: that takes seconds."""

    def run(command: list[str], **_: object) -> subprocess.CompletedProcess[bytes]:
        assert command[:2] == [sys.executable, "-m"]
        assert find_spec(command[2]) is not None
        code, out, err = Forked(*command[3:], work=act_again).end()
        return subprocess.CompletedProcess(command, code or 0, out.encode(), err.encode())

    monkeypatch.setattr("swarmdata.evaluation.leaderboard.verify.subprocess.run", run)
