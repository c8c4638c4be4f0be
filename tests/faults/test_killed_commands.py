"""A command that is killed at any moment is finished by running it again."""

import json
from pathlib import Path

import pytest

from tests.faults.test_processes import start

pytest.importorskip("torch", reason="a run is trained")
pytest.importorskip("matplotlib", reason="figures need the plots extra")


@pytest.mark.slow
@pytest.mark.parametrize("how", ["points", "times"])
@pytest.mark.parametrize("command", ["sweep", "catalogue", "export-policy", "study"])
def test_kills_are_survived(
    tmp_path: Path, command: str, how: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Rows 01, 58: workers end, the next run gives the bytes of an undisturbed one."""
    if command == "export-policy":
        pytest.importorskip("onnx", reason="the exported file is ONNX")
    process = start("killed_commands", command, tmp_path, how, "10")
    out, err = process.communicate(timeout=3000)
    assert process.returncode == 0, err
    found = json.loads(out.splitlines()[-1])
    with capsys.disabled():
        print(f"\n{command}, {how}: {found['kills']} of {found['tries']} killed and survived")
    assert found["kills"] > 0
