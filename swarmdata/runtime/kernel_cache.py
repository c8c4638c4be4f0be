"""numba's cache of a compiled function, with checked files, a pack behind it, and one compiler.

A kernel is looked for in the user's cache, root's, and the wheel's pack (`kernel_pack`). Reading it
runs code: a file is not believed that is damaged, or that another user could have written.
"""

import contextlib
import gc
import hashlib
import logging
import os
import pickle
import stat
from collections.abc import Callable, Iterator
from functools import cache
from itertools import count
from pathlib import Path
from typing import Any, BinaryIO

from llvmlite import binding
from numba.core import config, event
from numba.core.caching import FunctionCache, IndexDataCacheFile

from swarmdata.errors import BuildError
from swarmdata.runtime.kernel_progress import PROGRESS
from swarmdata.runtime.locking import Lock

PACK_CPU = "x86-64-v3"
"""The CPU, in LLVM's words, that packs are compiled for: every x86-64 with AVX2."""

PACK_FEATURES = ("avx", "avx2", "bmi", "bmi2", "cx16", "f16c", "fma", "lzcnt", "movbe", "popcnt")
"""What a CPU needs to run code for `PACK_CPU`, in LLVM's words (llvm/lib/TargetParser)."""

MAX_WAIT = 120.0
"""Seconds to wait for another process that compiles the same kernel; it may have been stopped."""

COLLECTED_TOGETHER = 100_000
"""Objects between two collections of garbage while numba compiles; Python's default is 700."""

_LOG = logging.getLogger("swarmdata")


class KernelCache(FunctionCache):  # type: ignore[misc]  # numba is untyped
    """numba's cache of a function; a damaged file or a full disk costs time, and nothing else.

    `root` has the caches of all kernels, and the locks that processes share; `shared`, if there is
    one, is like it and only read. `pack` has kernels that were compiled beforehand from the same
    source; it need not exist, and is trusted as the package is.
    """

    def __init__(
        self, function: Callable[..., Any], root: Path, pack: Path, shared: Path | None = None
    ) -> None:
        super().__init__(function)
        name, stamp = self._impl.filename_base, self._impl.locator.get_source_stamp()
        self._cache_file = _CheckedFiles(self._cache_path, name, stamp)
        self._pack = _CheckedFiles(str(pack), name, stamp, is_shipped=True)
        place = None if shared is None else shared / Path(self._cache_path).relative_to(root)
        self._shared = None if place is None else _CheckedFiles(str(place), name, stamp)
        self._root = root

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The compiled code of a signature, None if this process has to compile it."""
        found = self._kept(sig, target_context)
        if found is None and self._shared is not None:
            key = self._index_key(sig, target_context.codegen())
            found = self._read(self._shared, key, target_context)
        if found is None:
            found = self._packed(sig, target_context)
        if found is None and _wait_for_turn(self._root, self._turn(sig)):
            found = self._kept(sig, target_context)
            if found is not None:
                PROGRESS.waited()
                self.end_turn(sig)
        return found

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keeps the compiled code, if it can be kept."""
        try:
            super().save_overload(sig, data)
        except (OSError, _UntrustedError) as error:
            problem = getattr(error, "strerror", None) or str(error)
            _warn_once(UNKEPT, str(self._cache_path), problem)
        finally:
            self.end_turn(sig)

    def end_turn(self, sig: Any) -> None:
        """Lets other processes compile a signature, or load what this one has compiled."""
        if (turn := self._turn(sig)) in _turns:
            _turns.pop(turn).release()

    def _kept(self, sig: Any, target_context: Any) -> Any:
        """The code in the user's cache, None if there is none that can be believed."""
        try:
            return super().load_overload(sig, target_context)
        except Exception as error:  # whatever unpickling makes of damaged bytes
            _warn_once(DAMAGED, str(self._cache_path), f"{type(error).__name__}: {error}")
            with contextlib.suppress(OSError):
                self._cache_file.flush()  # so that it is written again
            return None

    def _packed(self, sig: Any, target_context: Any) -> Any:
        """The code in the pack, None if there is none for this CPU, numba and Python."""
        if not runs_pack():
            return None
        _, (triple, _, _), code = self._index_key(sig, target_context.codegen())
        return self._read(self._pack, (sig, (triple, PACK_CPU, ""), code), target_context)

    def _read(self, files: "_CheckedFiles", key: Any, target_context: Any) -> Any:
        """The code in files that are not this user's, None if there is none to be believed."""
        try:
            data = files.load(key)
            return None if data is None else self._impl.rebuild(target_context, data)
        except Exception as error:  # the same
            _warn_once(DAMAGED, str(files._cache_path), f"{type(error).__name__}: {error}")
            return None

    def _turn(self, sig: Any) -> str:
        return f"{self._cache_path}/{self._impl.filename_base} {sig}"


class _UntrustedError(ValueError):
    """A file is not read, for another user can have written it."""


class _CheckedFiles(IndexDataCacheFile):  # type: ignore[misc]  # numba is untyped
    """The files of a cache, each with the SHA-256 of its content."""

    def __init__(self, path: str, name: str, stamp: Any, *, is_shipped: bool = False) -> None:
        super().__init__(path, name, stamp)
        self._is_shipped = is_shipped  # with the package, whoever owns it

    def save(self, key: Any, data: Any) -> None:
        """Writes the code before the index, which else may name older code of other types."""
        overloads = self._load_index()
        taken = {*overloads.values()}
        free = (name for name in map(self._data_name, count(1)) if name not in taken)
        name = overloads.get(key) or next(free)
        self._save_data(name, data)
        self._save_index({**overloads, key: name})

    def _dump(self, obj: Any) -> bytes:
        content: bytes = super()._dump(obj)
        return hashlib.sha256(content).digest() + content

    def _load_index(self) -> Any:
        try:
            file = self._open(self._index_path)
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
        with self._open(path) as file:
            return pickle.loads(_checked(file.read(), path))

    def _open(self, path: str) -> BinaryIO:
        """Opens a file, if nobody but this user and root can have written it."""
        file = Path(path).open("rb")  # noqa: SIM115  (the caller closes it)
        status = os.fstat(file.fileno())
        is_ours = status.st_uid in (os.geteuid(), 0)
        is_shared = status.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
        if not self._is_shipped and (is_shared or not is_ours):
            file.close()
            raise _UntrustedError(f"{path} can have been written by another user")
        return file

    @contextlib.contextmanager
    def _open_for_write(self, filepath: str) -> Iterator[BinaryIO]:
        with super()._open_for_write(filepath) as file:
            os.fchmod(file.fileno(), 0o644)  # whatever the umask is, or it would not be believed
            yield file


def _checked(content: bytes, path: str) -> bytes:
    """What follows the SHA-256 at the begin of a file."""
    digest, rest = content[:32], content[32:]
    if hashlib.sha256(rest).digest() != digest:
        raise ValueError(f"{path} has another SHA-256 than it was written with")
    return rest


@cache
def runs_pack() -> bool:
    """Whether this CPU runs code for `PACK_CPU`, and numba compiles for this CPU."""
    if config.CPU_NAME is not None or config.CPU_FEATURES is not None:
        return False
    has = binding.get_host_cpu_features()
    return all(has.get(feature) for feature in PACK_FEATURES)


_turns: dict[str, Lock] = {}  # kernels that this process compiles


def _wait_for_turn(root: Path, turn: str) -> bool:
    """Waits until no other process compiles a kernel; whether one did so meanwhile."""
    if turn in _turns:
        return False
    name = hashlib.sha256(turn.encode()).hexdigest()[:16]
    kernel = turn.rpartition("/")[2].partition("-")[0]  # without its line and argument types
    lock = Lock(root / f".{name}.lock", f"the compiler of {kernel}")
    try:
        root.mkdir(parents=True, exist_ok=True)
        has_waited = not lock.acquire(0.0)
        is_held = not has_waited or lock.acquire(MAX_WAIT, shown=False)
    except (OSError, BuildError):  # no lock can be made here: every process compiles for itself
        return False
    if is_held:
        _turns[turn] = lock
    return has_waited


class _Compilations(event.Listener):  # type: ignore[misc]  # numba is untyped
    """Follows what numba compiles; the garbage of that, which is little, is collected rarely."""

    def __init__(self) -> None:
        self._depth, self._threshold = 0, gc.get_threshold()

    def on_start(self, event: Any) -> None:
        if self._depth == 0:
            self._threshold = gc.get_threshold()
            gc.set_threshold(COLLECTED_TOGETHER if self._threshold[0] else 0, *self._threshold[1:])
        self._depth += 1
        PROGRESS.begin()

    def on_end(self, event: Any) -> None:
        self._depth -= 1
        if self._depth == 0:
            gc.set_threshold(*self._threshold)
        dispatcher, types = event.data["dispatcher"], event.data["args"]
        PROGRESS.end(dispatcher.py_func.__module__)
        # what has failed is not saved; `event.is_failed` is true of what has not (numba 0.68)
        if types not in dispatcher.overloads and isinstance(dispatcher._cache, KernelCache):
            dispatcher._cache.end_turn(types)


event.register("numba:compile", _Compilations())


_said: set[str] = set()  # problems of the cache that this process has warned about


DAMAGED = (
    "a compiled kernel in %s cannot be trusted or is damaged (%s): it was not run, and is compiled "
    "again"
)
UNKEPT = (
    "compiled kernels cannot be kept in %s (%s), so every process compiles them anew: make room, "
    "or set SWARMDATA_CACHE or NUMBA_CACHE_DIR to another folder"
)


def _warn_once(warning: str, folder: str, problem: str) -> None:
    if warning not in _said:
        _said.add(warning)
        _LOG.warning(warning, folder, problem)
