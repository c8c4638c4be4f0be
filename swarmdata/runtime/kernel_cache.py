"""numba's cache of a compiled function, with checked files, a pack behind it, and one compiler.

A kernel is looked for in the user's cache, then in the pack of the wheel (`kernel_pack`), and then
compiled. A file that is damaged is not believed: numba would crash, or run other code. Where
several processes need one kernel, such as the workers of a build, one compiles it and the others
wait for its file.
"""

import contextlib
import errno
import fcntl
import hashlib
import logging
import os
import pickle
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

from llvmlite import binding
from numba.core import config, event
from numba.core.caching import FunctionCache, IndexDataCacheFile

from swarmdata.runtime.kernel_progress import PROGRESS

PACK_CPU = "x86-64-v3"
"""The CPU, in LLVM's words, that packs are compiled for: every x86-64 with AVX2."""

PACK_FEATURES = ("avx", "avx2", "bmi", "bmi2", "cx16", "f16c", "fma", "lzcnt", "movbe", "popcnt")
"""What a CPU needs to run code for `PACK_CPU`, in LLVM's words (llvm/lib/TargetParser)."""

MAX_WAIT = 120.0
"""Seconds to wait for another process that compiles the same kernel; it may have been stopped."""

_POLL = 0.05  # s

_LOG = logging.getLogger("swarmdata")


class KernelCache(FunctionCache):  # type: ignore[misc]  # numba is untyped
    """numba's cache of a function; a damaged file or a full disk costs time, and nothing else.

    Args:
        function: in Python.
        root: folder of the caches of all kernels; the lock that processes share is in it.
        pack: folder with kernels that were compiled beforehand from the same source; it need not
            exist.
    """

    def __init__(self, function: Callable[..., Any], root: Path, pack: Path) -> None:
        super().__init__(function)
        name, stamp = self._impl.filename_base, self._impl.locator.get_source_stamp()
        self._cache_file = _CheckedFiles(self._cache_path, name, stamp)
        self._pack = _CheckedFiles(str(pack), name, stamp)
        self._root = root

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The compiled code of a signature, None if this process has to compile it."""
        found = self._kept(sig, target_context)
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
        except OSError as error:
            _warn_unkept(str(self._cache_path), str(error.strerror or error))
        finally:
            self.end_turn(sig)

    def end_turn(self, sig: Any) -> None:
        """Lets other processes compile a signature, or load what this one has compiled."""
        _end_turn(self._root, self._turn(sig))

    def _kept(self, sig: Any, target_context: Any) -> Any:
        """The code in the user's cache, None if there is none that can be believed."""
        try:
            return super().load_overload(sig, target_context)
        except Exception as error:  # whatever unpickling makes of damaged bytes
            _warn_damaged(str(self._cache_path), f"{type(error).__name__}: {error}")
            with contextlib.suppress(OSError):
                self._cache_file.flush()  # so that it is written again
            return None

    def _packed(self, sig: Any, target_context: Any) -> Any:
        """The code in the pack, None if there is none for this CPU, numba and Python."""
        if not runs_pack():
            return None
        _, (triple, _, _), code = self._index_key(sig, target_context.codegen())
        try:
            data = self._pack.load((sig, (triple, PACK_CPU, ""), code))
            return None if data is None else self._impl.rebuild(target_context, data)
        except Exception as error:  # the same
            _warn_damaged(self._pack.folder, f"{type(error).__name__}: {error}")
            return None

    def _turn(self, sig: Any) -> str:
        return f"{self._cache_path}/{self._impl.filename_base} {sig}"


class _CheckedFiles(IndexDataCacheFile):  # type: ignore[misc]  # numba is untyped
    """The files of a cache, each with the SHA-256 of its content."""

    @property
    def folder(self) -> str:
        return str(self._cache_path)

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
def runs_pack() -> bool:
    """Whether this CPU runs code for `PACK_CPU`, and numba compiles for this CPU.

    The files of a pack are of one version of numba and of Python, and of one operating system,
    which are parts of their keys; elsewhere nothing is found in them.
    """
    if config.CPU_NAME is not None or config.CPU_FEATURES is not None:
        return False
    has = binding.get_host_cpu_features()
    return all(has.get(feature) for feature in PACK_FEATURES)


@cache
def _lock_file(root: Path) -> int:
    """Descriptor of the file whose bytes are the locks of kernels; open while the process runs.

    POSIX locks of a process are lost when it closes any descriptor of the file.
    """
    root.mkdir(parents=True, exist_ok=True)
    return os.open(root / "compiling.lock", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)


def _byte_of(turn: str) -> int:
    return int.from_bytes(hashlib.sha256(turn.encode()).digest()[:4], "big") >> 1


def _wait_for_turn(root: Path, turn: str) -> bool:
    """Waits until no other process compiles a kernel; whether one did so meanwhile.

    Without locks, as on some network file systems, every process compiles for itself.
    """
    end = time.monotonic() + MAX_WAIT
    has_waited = False
    while time.monotonic() < end:
        try:
            fcntl.lockf(_lock_file(root), fcntl.LOCK_EX | fcntl.LOCK_NB, 1, _byte_of(turn))
        except OSError as error:
            if error.errno not in (errno.EACCES, errno.EAGAIN):
                return has_waited
            has_waited = True
            time.sleep(_POLL)
        else:
            break
    return has_waited


def _end_turn(root: Path, turn: str) -> None:
    with contextlib.suppress(OSError):  # there are no locks here, so none is held
        fcntl.lockf(_lock_file(root), fcntl.LOCK_UN, 1, _byte_of(turn))


class _Compilations(event.Listener):  # type: ignore[misc]  # numba is untyped
    """Follows what numba compiles."""

    def on_start(self, event: Any) -> None:
        PROGRESS.begin()

    def on_end(self, event: Any) -> None:
        dispatcher, types = event.data["dispatcher"], event.data["args"]
        PROGRESS.end(dispatcher.py_func.__module__)
        # what has failed is not saved; `event.is_failed` is true of what has not (numba 0.68)
        if types not in dispatcher.overloads and isinstance(dispatcher._cache, KernelCache):
            dispatcher._cache.end_turn(types)


event.register("numba:compile", _Compilations())


_said: set[str] = set()
"""Problems of the cache that this process has warned about."""


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
