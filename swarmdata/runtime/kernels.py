"""`kernel`, numba's `njit` with a cache on disk that notices every change of source.

numba keys the cache of a function by the file that holds it. What the function calls from another
file is compiled into it, and may change without notice: after an update of some files, old code
would go on running. Here the key is a digest of the module and of every module of this package that
it imports, directly or not. A file of the cache that is damaged is not believed: numba would crash,
or run other code; here it is compiled again.
"""

import contextlib
import hashlib
import logging
import os
import pickle
import re
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numba
from numba.core import config, event
from numba.core.caching import FunctionCache, IndexDataCacheFile
from platformdirs import user_cache_path

PACKAGE_FOLDER = Path(__file__).parents[1]

_IMPORT = re.compile(rb"^\s*(?:from|import) (swarmdata[\w.]*)", re.MULTILINE)

_LOG = logging.getLogger("swarmdata")


def kernel(function: Callable[..., Any] | None = None, **options: Any) -> Any:
    """Compiles a function on its first call, without the GIL, and keeps the code on disk.

    Args:
        function: in plain Python that numba understands.
        options: of `numba.njit`, such as `inline="always"`.

    Returns:
        The compiled function, or without `function` a decorator.
    """
    if function is None:
        return lambda decorated: kernel(decorated, **options)
    before = config.CACHE_DIR  # read by numba when it decorates
    config.CACHE_DIR = str(cache_folder(function.__module__, before))
    try:
        dispatcher = numba.njit(function, nogil=True, **options)
        dispatcher._cache = KernelCache(dispatcher.py_func)  # what `cache=True` does, with ours
        return dispatcher
    except RuntimeError as error:
        if "no locator available" not in str(error):  # numba's words for: nowhere may I write
            raise
        _warn_uncached()
        return numba.njit(function, nogil=True, **options)
    finally:
        config.CACHE_DIR = before


class KernelCache(FunctionCache):  # type: ignore[misc]  # numba is untyped
    """numba's cache of a function; a damaged file or a full disk costs time, and nothing else."""

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        self._cache_file = _CheckedFiles(
            self._cache_path, self._impl.filename_base, self._impl.locator.get_source_stamp()
        )

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The compiled code of a signature, None if there is none that can be believed."""
        try:
            return super().load_overload(sig, target_context)
        except Exception as error:  # whatever unpickling makes of damaged bytes
            _warn_damaged(str(self._cache_path), f"{type(error).__name__}: {error}")
            with contextlib.suppress(OSError):
                self._cache_file.flush()  # so that it is written anew
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keeps the compiled code, if it can be kept."""
        try:
            super().save_overload(sig, data)
        except OSError as error:
            _warn_unkept(str(self._cache_path), str(error.strerror or error))


class _CheckedFiles(IndexDataCacheFile):  # type: ignore[misc]  # numba is untyped
    """The files of a cache, each with the SHA-256 of its content."""

    def _dump(self, obj: Any) -> bytes:
        content: bytes = super()._dump(obj)
        return hashlib.sha256(content).digest() + content

    def _load_index(self) -> Any:
        try:
            file = Path(self._index_path).open("rb")  # noqa: SIM115  (closed below)
        except FileNotFoundError:
            return {}
        with file:
            version, content = pickle.load(file), file.read()
        if version != self._version:
            return {}
        stamp, overloads = pickle.loads(_checked(content, self._index_path))
        return overloads if stamp == self._source_stamp else {}

    def _load_data(self, name: str) -> Any:
        path = self._data_path(name)
        return pickle.loads(_checked(Path(path).read_bytes(), path))


def _checked(content: bytes, path: str) -> bytes:
    """What follows the SHA-256 at the begin of a file.

    Raises:
        ValueError: it is not that of what follows.
    """
    digest, rest = content[:32], content[32:]
    if hashlib.sha256(rest).digest() != digest:
        raise ValueError(f"{path} has another SHA-256 than it was written with")
    return rest


@cache
def _warn_uncached() -> None:
    """Once in a process."""
    _LOG.warning(
        "no folder can be written to keep compiled kernels in, so every process compiles them "
        "anew: set SWARMDATA_CACHE or NUMBA_CACHE_DIR to one that can"
    )


_said: set[str] = set()
"""Problems of the cache that were told of in this process."""


def _warn_damaged(folder: str, problem: str) -> None:
    if "damaged" not in _said:
        _said.add("damaged")
        _LOG.warning(
            "a compiled kernel in %s is damaged (%s): it is compiled again, and the file replaced",
            folder,
            problem,
        )


def _warn_unkept(folder: str, problem: str) -> None:
    if "unkept" not in _said:
        _said.add("unkept")
        _LOG.warning(
            "compiled kernels cannot be kept in %s (%s), so every process compiles them anew: make "
            "room, or set SWARMDATA_CACHE or NUMBA_CACHE_DIR to another folder",
            folder,
            problem,
        )


def cache_folder(module: str, base: str = "") -> Path:
    """Where the compiled code of a module's functions is kept.

    Args:
        module: dotted name.
        base: `NUMBA_CACHE_DIR` if it is set; by default `kernels` in `SWARMDATA_CACHE`, or in the
            user's cache folder.
    """
    named = os.environ.get("SWARMDATA_CACHE")
    ours = Path(named) if named else user_cache_path("swarmdata")
    root = Path(base) if base else ours / "kernels"
    return root / digest_of(module)


@cache
def digest_of(module: str) -> str:
    """Digest of a module's source and of all modules of this package that it imports, hex."""
    found, waiting = {module}, [module]
    while waiting:
        fresh = _imports_of(waiting.pop()) - found
        found |= fresh
        waiting += fresh
    total = hashlib.sha256()
    for name in sorted(found):
        total.update(name.encode() + b"\0" + hashlib.sha256(_source_of(name)).digest())
    return total.hexdigest()[:24]


@cache
def _imports_of(module: str) -> frozenset[str]:
    """Modules of this package that the source of one names in imports."""
    return frozenset(name.decode() for name in _IMPORT.findall(_source_of(module)))


@cache
def _source_of(module: str) -> bytes:
    """Source of a module of this package; nothing for other names, and where there is no file."""
    path = PACKAGE_FOLDER.joinpath(*module.split(".")[1:])
    files = (path.with_suffix(".py"), path / "__init__.py")
    return next((file.read_bytes() for file in files if file.is_file()), b"")


class _Announcer(event.Listener):  # type: ignore[misc]  # numba is untyped
    """Says once that kernels are compiled, since the first call then takes long."""

    def __init__(self) -> None:
        self.has_spoken = False

    def on_start(self, event: Any) -> None:
        module = event.data["dispatcher"].py_func.__module__
        if not self.has_spoken and module.startswith("swarmdata."):
            self.has_spoken = True
            _LOG.warning("compiling kernels, once for this version on this machine: up to a minute")

    def on_end(self, event: Any) -> None:
        """Nothing to say."""


event.register("numba:compile", _Announcer())
