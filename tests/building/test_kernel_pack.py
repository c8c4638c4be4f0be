"""A pack is used where it fits, and ignored elsewhere; the kernels give the same either way."""

import os
import pickle
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from llvmlite import binding

from swarmdata.building.kernel_pack import gather
from swarmdata.runtime import kernel_cache
from tests.support.interpreter import python

SCRIPT = """
from pathlib import Path
import sys
from swarmdata.runtime import kernels
kernels.PACK_FOLDER = Path(sys.argv[1])

@kernels.kernel
def halve(x: float) -> float:
    return 0.5 * x

assert halve(3.0) == 1.5
print(sum(halve.stats.cache_hits.values()))
"""

FOR_PACKS = {"NUMBA_CPU_NAME": kernel_cache.PACK_CPU, "NUMBA_CPU_FEATURES": ""}

pytestmark = pytest.mark.skipif(
    not kernel_cache.runs_pack(), reason="packs are for x86-64 with AVX2"
)


@pytest.fixture(scope="module")
def script(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("script") / "script.py"
    path.write_text(SCRIPT)
    return path


def run(script: Path, pack: Path, cache: Path, **environment: str) -> int:
    """How many kernels were loaded."""
    variables = {**os.environ, "NUMBA_CACHE_DIR": str(cache), **environment}
    return int(python(script, pack, env=variables).stdout)


@pytest.fixture(scope="module")
def pack(script: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("made")
    assert run(script, folder / "none", folder / "kernels", **FOR_PACKS) == 0
    gather((folder / "kernels").rglob("*.nbc"), folder / "pack")
    return folder / "pack"


@pytest.mark.slow
def test_a_kernel_of_the_pack_is_not_compiled(script: Path, pack: Path, tmp_path: Path) -> None:
    assert run(script, pack, tmp_path / "kernels") == 1
    assert not list(tmp_path.rglob("*.nbc"))


@pytest.mark.slow
def test_a_pack_needs_no_kernel_that_only_kernels_call(script: Path, tmp_path: Path) -> None:
    text = script.read_text().replace("return 0.5 * x", "return half() * x")
    mark = "@kernels.kernel\n"
    nested = tmp_path / "nested.py"
    nested.write_text(text.replace(mark, f"{mark}def half() -> float:\n    return 0.5\n\n{mark}"))
    run(nested, tmp_path / "none", tmp_path / "kernels", **FOR_PACKS)
    compiled = {file.name.split("-")[0]: file for file in (tmp_path / "kernels").rglob("*.nbc")}
    assert {"nested.half", "nested.halve"} == compiled.keys()

    gather([compiled["nested.halve"]], tmp_path / "pack")
    assert len(list((tmp_path / "pack").rglob("*.nb[ci]"))) == 2
    assert run(nested, tmp_path / "pack", tmp_path / "new") == 1
    assert not list((tmp_path / "new").rglob("*.nbc"))


@pytest.mark.slow
def test_another_cpu_compiles(script: Path, pack: Path, tmp_path: Path) -> None:
    assert run(script, pack, tmp_path / "kernels", NUMBA_CPU_NAME="generic") == 0
    assert list(tmp_path.rglob("*.nbc"))


def of_another_numba(index: Path) -> None:
    content = index.read_bytes()
    version = pickle.loads(content)
    index.write_bytes(content.replace(version.encode(), b"0" * len(version), 1))


@pytest.mark.slow
@pytest.mark.parametrize("spoil", [of_another_numba, Path.unlink])
def test_a_pack_that_does_not_fit_is_ignored(
    script: Path, pack: Path, tmp_path: Path, spoil: Callable[[Path], None]
) -> None:
    (index,) = Path(shutil.copytree(pack, tmp_path / "pack")).rglob("*.nbi")
    spoil(index)
    assert run(script, tmp_path / "pack", tmp_path / "kernels") == 0


def test_a_cpu_without_avx2_runs_no_pack(monkeypatch: pytest.MonkeyPatch) -> None:
    features = {name: name != "avx2" for name in kernel_cache.PACK_FEATURES}
    monkeypatch.setattr(binding, "get_host_cpu_features", lambda: features)
    assert not kernel_cache.runs_pack.__wrapped__()
