"""Kernels are cached by all the source that is compiled into them."""

import errno
import logging
import os
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from numba.core import config
from numba.core.caching import IndexDataCacheFile

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


def test_the_engine_depends_on_geometry() -> None:
    source = kernels.PACKAGE_FOLDER / "numerics" / "geometry.py"
    assert "swarmdata.numerics.geometry" in kernels._imports_of("swarmdata.envs.physics.contacts")
    assert kernels._source_of("swarmdata.numerics.geometry") == source.read_bytes()


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


def test_the_first_compilation_is_announced_once(caplog: pytest.LogCaptureFixture) -> None:
    class Event:
        def __init__(self, module: str) -> None:
            function = type("F", (), {"__module__": module})
            self.data = {"dispatcher": type("D", (), {"py_func": function})}

    announcer = kernels._Announcer()
    with caplog.at_level(logging.WARNING, "swarmdata"):
        announcer.on_start(Event("somebody.elses"))
        assert not caplog.records
        announcer.on_start(Event("swarmdata.numerics.geometry"))
        announcer.on_start(Event("swarmdata.numerics.geometry"))
    assert [record.message for record in caplog.records] == [
        "compiling kernels, once for this version on this machine: up to a minute"
    ]


def compiled_twice() -> list[Callable[[float], float]]:
    """Two kernels as two processes would make them, one after the other."""

    def halve(x: float) -> float:
        return 0.5 * x

    return [kernel(halve), kernel(halve)]


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder for kernels, and nothing said yet."""
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path / "kernels"))
    monkeypatch.setattr(kernels, "_said", set())
    return tmp_path / "kernels"


def cut(file: Path) -> None:
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])


def flip(file: Path) -> None:
    content = bytearray(file.read_bytes())
    content[-40] ^= 1
    file.write_bytes(content)


@pytest.mark.parametrize("kind", ["*.nbi", "*.nbc"])
@pytest.mark.parametrize(
    "damage",
    [lambda f: f.write_bytes(b""), lambda f: f.write_bytes(b"\x80"), cut, flip],
    ids=["empty", "one byte", "half", "bit"],
)
def test_a_damaged_file_is_compiled_again_and_said_once(
    cache: Path, caplog: pytest.LogCaptureFixture, kind: str, damage: Callable[[Path], None]
) -> None:
    """Row 61: a truncated file was an EOFError without a name, a flipped bit other code."""
    first, second = compiled_twice()
    assert first(3.0) == 1.5
    (file,) = cache.rglob(kind)
    whole = file.read_bytes()
    damage(file)
    with caplog.at_level(logging.WARNING, "swarmdata"):
        assert second(3.0) == 1.5
        damage(file)
        assert compiled_twice()[0](5.0) == 2.5
    (said,) = [each.message for each in caplog.records if "damaged" in each.message]
    assert str(file.parent) in said
    assert "compiled again" in said
    third = compiled_twice()[0]
    assert third(3.0) == 1.5
    assert sum(third.stats.cache_hits.values()) == 1, "the file was replaced"  # type: ignore[attr-defined]
    assert len(file.read_bytes()) == len(whole)


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EMFILE])
def test_a_cache_that_cannot_be_written_is_said_once(
    cache: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    """Row 61: a full disk was a raw OSError."""

    def refuse(*arguments: object) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(IndexDataCacheFile, "_open_for_write", refuse)
    with caplog.at_level(logging.WARNING, "swarmdata"):
        assert [each(3.0) for each in compiled_twice()] == [1.5, 1.5]
    (said,) = [each.message for each in caplog.records if "cannot be kept" in each.message]
    assert os.strerror(number) in said
    assert "SWARMDATA_CACHE" in said


def test_the_cache_moves_with_that_of_datasets(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SWARMDATA_CACHE", str(tmp_path / "here"))
    assert cache_folder("m").parent == tmp_path / "here" / "kernels"
    assert cache_folder("m", str(tmp_path / "numba")).parent == tmp_path / "numba"
    monkeypatch.delenv("SWARMDATA_CACHE")
    assert cache_folder("m").parent.name == "kernels"
