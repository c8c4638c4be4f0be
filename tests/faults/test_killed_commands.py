"""A command that is killed at any moment is finished by running it again."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

pytestmark = pytest.mark.slow

pytest.importorskip("torch", reason="a run is trained")
pytest.importorskip("matplotlib", reason="figures need the plots extra")


@pytest.mark.parametrize("command", ["sweep", "catalogue", "export-policy", "study"])
def test_kills_are_survived(
    tmp_path: Path, command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Rows 01, 58: workers end, the next run gives the bytes of an undisturbed one."""
    if command == "export-policy":
        pytest.importorskip("onnx", reason="the exported file is ONNX")
    line = [sys.executable, "-m", "tests.faults.killed_commands", command, str(tmp_path)]
    paths = {"PYTHONPATH": os.pathsep.join([str(ROOT), *filter(None, sys.path)])}
    done = subprocess.run(
        [*line, "10"],
        cwd=ROOT,
        env={**os.environ, **paths},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout.splitlines()[-1])
    with capsys.disabled():
        print(f"\n{command}: {found['kills']} of {found['tries']} killed and survived")
    assert found["kills"] > 0
