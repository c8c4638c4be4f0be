"""`kernel`, numba's `njit` with a cache on disk that notices every change of source.

numba keys the cache of a function by the file that holds it. What the function calls from another
file is compiled into it, and may change without notice: after an update of some files, old code
would go on running. Here the key is a digest of the module and of every module of this package that
it imports, directly or not. `kernel_cache` says where compiled code is looked for.
"""

import hashlib
import logging
import os
import re
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

    Args:
        function: in plain Python that numba understands.
        options: of `numba.njit`, such as `inline="always"`.

    Returns:
        The compiled function, or without `function` a decorator.
    """
    if function is None:
        return lambda decorated: kernel(decorated, **options)
    dispatcher = numba.njit(function, nogil=True, **options)
    if "inline" not in options:
        PROGRESS.kernels.append(dispatcher)
    before = config.CACHE_DIR  # read by numba when it makes a cache
    folder = cache_folder(function.__module__, before)
    config.CACHE_DIR = str(folder)
    try:  # what `cache=True` does, with ours
        dispatcher._cache = KernelCache(function, folder.parent, PACK_FOLDER / folder.name)
    except RuntimeError as error:
        if "no locator available" not in str(error):  # numba's words for: nowhere may I write
            raise
        _warn_uncached()
    finally:
        config.CACHE_DIR = before
    return dispatcher


@cache
def _warn_uncached() -> None:
    """Once in a process."""
    _LOG.warning(
        "no folder can be written to keep compiled kernels in, so every process compiles them "
        "anew: set SWARMDATA_CACHE or NUMBA_CACHE_DIR to one that can"
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
