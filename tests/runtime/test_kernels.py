"""Kernels are cached by all the source that is compiled into them."""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from numba.core import config

from swarmdata.runtime import kernels
from swarmdata.runtime.kernels import cache_folder, digest_of, kernel


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A package of three modules: `a` imports `b`, which imports `deep.c`."""
    (tmp_path / "deep").mkdir()
    (tmp_path / "deep" / "__init__.py").write_text("")
    (tmp_path / "a.py").write_text("from swarmdata.b import f\nimport numpy\n")
    (tmp_path / "b.py").write_text("def g():\n    import swarmdata.deep.c\n")
    (tmp_path / "deep" / "c.py").write_text("from swarmdata.a import cycle\n")
    (tmp_path / "other.py").write_text("")
    monkeypatch.setattr(kernels, "PACKAGE_FOLDER", tmp_path)
    forget()
    yield tmp_path
    monkeypatch.undo()
    forget()


def forget() -> None:
    for function in (kernels.digest_of, kernels._imports_of, kernels._source_of):
        function.cache_clear()


@pytest.mark.parametrize("changed", ["a.py", "b.py", "deep/c.py"])
def test_a_change_anywhere_below_changes_the_digest(package: Path, changed: str) -> None:
    before = digest_of("swarmdata.a")
    file = package / changed
    file.write_text(file.read_text() + "# changed\n")
    forget()
    assert digest_of("swarmdata.a") != before


def test_other_modules_do_not_matter(package: Path) -> None:
    before = digest_of("swarmdata.a")
    (package / "other.py").write_text("# changed\n")
    forget()
    assert digest_of("swarmdata.a") == before
    assert digest_of("swarmdata.other") != before


def test_kernels_compute_and_are_kept_on_disk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path))

    @kernel
    def double(x: float) -> float:
        return 2.0 * x

    @kernel(inline="always")  # type: ignore[untyped-decorator]  # numba functions are Any
    def triple(x: float) -> float:
        return 3.0 * x

    assert (double(1.5), triple(1.5)) == (3.0, 4.5)
    assert str(tmp_path) == config.CACHE_DIR, "the setting of others is put back"
    folder = cache_folder(__name__, str(tmp_path))
    assert list(folder.rglob("*double*.nbi"))


def test_the_cache_moves_with_that_of_datasets(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SWARMDATA_CACHE", str(tmp_path / "here"))
    assert cache_folder("m").parent == tmp_path / "here" / "kernels"
    assert cache_folder("m", str(tmp_path / "numba")).parent == tmp_path / "numba"
    monkeypatch.delenv("SWARMDATA_CACHE")
    assert cache_folder("m").parent.name == "kernels"


def test_the_folder_of_kernels_is_the_users_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Row 78: with others in one cache, each has a folder of his own."""
    monkeypatch.setenv("SWARMDATA_CACHE", str(tmp_path))
    monkeypatch.setattr(os, "geteuid", lambda: tmp_path.stat().st_uid or 0)
    assert cache_folder("m").parent == tmp_path / "kernels"
    (tmp_path / "kernels").chmod(0o777)
    assert cache_folder("m").parent == tmp_path / "kernels"
    assert not (tmp_path / "kernels").stat().st_mode & 0o022
    monkeypatch.setattr(os, "geteuid", lambda: 4242)
    assert cache_folder("m").parent == tmp_path / "kernels-4242"
    assert (tmp_path / "kernels-4242").stat().st_mode & 0o777 == 0o700


def test_a_link_of_somebody_else_is_no_folder_of_kernels(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SWARMDATA_CACHE", str(tmp_path))
    (tmp_path / "kernels").symlink_to(tmp_path)
    monkeypatch.setattr(kernels, "_owner", lambda folder: -1)
    assert cache_folder("m").parent == tmp_path / f"kernels-{os.geteuid()}"
