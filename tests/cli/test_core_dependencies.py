"""The core commands work where no extra is installed, and the others say which extra they need."""

import subprocess
import sys
import venv
from collections.abc import Iterator
from importlib.metadata import Distribution, distribution
from pathlib import Path

import pytest
from packaging.requirements import Requirement

import swarmdata

ROOT = Path(__file__).parents[2]


def core_distributions() -> dict[str, Distribution]:
    """swarmdata, and every distribution that it needs without extras, directly or not."""
    found: dict[str, Distribution] = {}
    seen: set[tuple[str, str]] = set()  # names with an extra, or with none
    waiting = [("swarmdata", "")]
    while waiting:
        name, extra = waiting.pop()
        if (name, extra) in seen:
            continue
        seen.add((name, extra))
        found[name] = distribution(name)
        needs = (Requirement(line) for line in found[name].requires or ())
        waiting += [
            (need.name, each)
            for need in needs
            if need.marker is None or need.marker.evaluate({"extra": extra})
            for each in ("", *need.extras)
        ]
    return found


def parts_of(installed: Distribution) -> Iterator[Path]:
    """What a distribution has at the top of `site-packages`."""
    names = {file.parts[0] for file in installed.files or ()} - {"..", "__pycache__"}
    parts = (Path(str(installed.locate_file(name))) for name in names)
    return (part for part in parts if part.suffix != ".pth")  # of this package, if it is editable


def make_environment(folder: Path) -> Path:
    """Makes a virtual environment with links to the core distributions; returns its Python."""
    venv.create(folder, symlinks=True)
    version = f"python{sys.version_info.major}.{sys.version_info.minor}"
    packages = folder / "lib" / version / "site-packages"
    (packages / "swarmdata.pth").write_text(str(Path(swarmdata.__file__).parents[1]))
    for part in {part for each in core_distributions().values() for part in parts_of(each)}:
        (packages / part.name).symlink_to(part)
    return folder / "bin" / "python"


@pytest.mark.slow
def test_commands_need_the_core_only(tmp_path: Path) -> None:
    python = make_environment(tmp_path / "core")
    script = ROOT / "tests" / "support" / "core_commands.py"
    (tmp_path / "work").mkdir()
    done = subprocess.run(
        [python, script, tmp_path / "work"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
