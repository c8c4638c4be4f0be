"""`kernel`, numba's `njit` with a cache on disk that notices every change of source.

numba keys its cache by the file of a function, though what it calls from others is compiled into
it. Here the key is a digest of the module and of all that it imports of this package.
"""

import contextlib
import hashlib
import logging
import os
import re
import stat
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numba
from numba.core import config
from platformdirs import user_cache_path

from swarmdata.runtime.kernel_cache import KernelCache
from swarmdata.runtime.kernel_progress import PROGRESS

PACKAGE_FOLDER = Path(__file__).parents[1]

PACK_FOLDER = Path(__file__).parent / "kernel_pack_files"
"""Kernels compiled beforehand, in a folder for each digest; only wheels have it (`kernel_pack`)."""

_IMPORT = re.compile(rb"^\s*(?:from|import) (swarmdata[\w.]*)", re.MULTILINE)

_LOG = logging.getLogger("swarmdata")


def kernel(function: Callable[..., Any] | None = None, **options: Any) -> Any:
    """Compiles a function on its first call, without the GIL, and keeps the code on disk.

    Options are those of `numba.njit`, such as `inline="always"`; without a function, a decorator is
    returned.
    """
    if function is None:
        return lambda decorated: kernel(decorated, **options)
    # nothing calls kernels from C
    dispatcher = numba.njit(function, nogil=True, no_cfunc_wrapper=True, **options)
    if "inline" not in options:
        PROGRESS.kernels.append(dispatcher)
    before = config.CACHE_DIR  # read by numba when it makes a cache
    folder = cache_folder(function.__module__, before)
    config.CACHE_DIR = str(folder)
    try:  # what `cache=True` does, with ours
        pack, shared = PACK_FOLDER / folder.name, shared_folder(before)
        dispatcher._cache = KernelCache(function, folder.parent, pack, shared)
    except RuntimeError as error:
        if "no locator available" not in str(error):  # numba's words for: nowhere may I write
            raise
        _warn_uncached()
    finally:
        config.CACHE_DIR = before
    return dispatcher


@cache
def _warn_uncached() -> None:
    _LOG.warning(
        "no folder can be written to keep compiled kernels in, so every process compiles them "
        "anew: set SWARMDATA_CACHE or NUMBA_CACHE_DIR to one that can"
    )


def cache_folder(module: str, base: str = "") -> Path:
    """Where the compiled code of a module's functions is kept: in `base`, such as NUMBA_CACHE_DIR.

    Without it in `kernels` in `SWARMDATA_CACHE`, or in the user's cache folder. Where somebody else
    has made that, `kernels-UID` beside it.
    """
    return (Path(base) if base else _own_folder(_common_folder())) / digest_of(module)


def shared_folder(base: str = "") -> Path | None:
    """Kernels that root has compiled for all users; None: there are none, or `base` is set."""
    folder = _common_folder()
    is_roots = not base and os.geteuid() and _owner(folder) == 0
    return folder if is_roots else None


def _common_folder() -> Path:
    named = os.environ.get("SWARMDATA_CACHE")
    return (Path(named) if named else user_cache_path("swarmdata")) / "kernels"


def _own_folder(common: Path) -> Path:
    """The folder of this user's kernels, which nobody else can write to; it is made."""
    user = os.geteuid()
    folder = common
    if _owner(common) not in (None, user):
        folder = common.with_name(f"{common.name}-{user}")
    mode = 0o700 if user else 0o755  # what root has compiled is for all, as in an image
    with contextlib.suppress(OSError):  # nothing can be written here: numba finds that out, too
        folder.mkdir(mode=mode, parents=True, exist_ok=True)
        if _owner(folder) == user and stat.S_IMODE(folder.stat().st_mode) != mode:
            folder.chmod(mode)
    return folder


def _owner(folder: Path) -> int | None:
    """Who owns a folder and a link to it, if it is one; -1 if they differ, None if it is absent."""
    try:
        owners = {folder.lstat().st_uid, folder.stat().st_uid}
    except FileNotFoundError:
        return None
    except OSError:
        return -1
    return owners.pop() if len(owners) == 1 else -1


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
