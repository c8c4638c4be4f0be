"""Modules of other people's code, imported from a checkout without what it needs beside learning.

Nothing is copied or changed: files run as they are. Packages that such a file imports for
downloads, logs, simulators or command lines are replaced by empty ones while it is imported, and
its own modules do not stay in `sys.modules`, where names like `utils` would hide others.
"""

import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from importlib import import_module
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import Any
from unittest.mock import MagicMock


class AbsentModule(ModuleType):
    """Stands for a package that is imported but not needed: every name in it is a mock."""

    __path__: list[str] = []  # noqa: RUF012  (a package, whose submodules are absent as well)

    def __getattr__(self, name: str) -> Any:
        """Makes a name up, the same one every time."""
        if name.startswith("__"):
            raise AttributeError(name)
        setattr(self, name, MagicMock(name=f"{self.__name__}.{name}"))
        return self.__dict__[name]


@contextmanager
def without(*names: str, **given: Mapping[str, Any]) -> Iterator[None]:
    """Replaces packages by empty ones; afterwards, `sys.modules` is what it was.

    Args:
        names: of packages and of their submodules that are imported.
        given: packages that need some real members, by name.
    """
    before = dict(sys.modules)
    for name in (*names, *given):
        sys.modules[name] = AbsentModule(name)
        for member, value in given.get(name, {}).items():
            setattr(sys.modules[name], member, value)
    try:
        yield
    finally:
        for name in (*names, *given):
            if name in before:
                sys.modules[name] = before[name]
            else:
                sys.modules.pop(name, None)


def read_module(file: Path, *absent: str) -> Any:
    """Runs one file as a module of its own.

    Args:
        file: of a checkout.
        absent: packages that it imports and that are not needed.

    Raises:
        FileNotFoundError: there is no such file.
    """
    if not file.is_file():
        raise FileNotFoundError(f"{file} does not exist, expected a file of the checkout")
    name = f"peer_{file.stem}"
    spec = spec_from_file_location(name, file)
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    with without(*absent):
        sys.modules[name] = module  # dataclasses look their module up
        try:
            spec.loader.exec_module(module)
        finally:
            del sys.modules[name]
    return module


def import_from(checkout: Path, name: str, *absent: str, **given: Mapping[str, Any]) -> Any:
    """Imports a module of a package whose top folder is the checkout.

    Args:
        checkout: folder that the package lies in.
        name: of the module, with dots.
        absent: packages that it imports and that are not needed.
        given: packages of which it needs only these members.

    Raises:
        ModuleNotFoundError: the checkout has no such module.
    """
    before = set(sys.modules)
    sys.path.insert(0, str(checkout))
    try:
        with without(*absent, **given):
            return import_module(name)
    finally:
        sys.path.remove(str(checkout))
        new = set(sys.modules) - before
        # all are found first: the path of an inner package asks for the outer one
        for own in [name for name in new if _is_of(sys.modules[name], checkout)]:
            del sys.modules[own]


def _is_of(module: ModuleType, checkout: Path) -> bool:
    """Whether a module, or a package even without an `__init__.py`, lies in the checkout."""
    paths = [getattr(module, "__file__", None), *getattr(module, "__path__", ())]
    return any(path and Path(path).is_relative_to(checkout) for path in paths)


def commit_of(checkout: Path) -> str:
    """The checkout's commit, or `unknown` if it is no working tree of git."""
    command = ["git", "-C", str(checkout), "rev-parse", "--show-toplevel", "--short", "HEAD"]
    found = subprocess.run(command, capture_output=True, text=True, check=False)
    lines = found.stdout.split("\n")
    is_its_own = not found.returncode and Path(lines[0]) == checkout.resolve()
    return lines[1] if is_its_own else "unknown"
