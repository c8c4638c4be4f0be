"""Files of others: what is refused before a library opens them, and whatever it raises as ours."""

import os
from collections.abc import Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import TypeVar

from swarmdata.errors import ConversionError, SwarmdataError, quoted

FREE_BYTES = 1 << 28  # bytes that any file may unfold to

MOST_EXPANSION = 200
"""Bytes that a larger file may unfold to for each of its own. Logs of robots at rest reach 100."""

MOST_ARRAY_EXPANSION = 2000
"""Bytes in memory for a stored one of an array: twice what gzip packs at best."""

FREE_ARRAY_BYTES = 16 << 20
"""Bytes of an array that need not be stored, such as flags that were never set."""

Item = TypeVar("Item")

_END = object()


class ForeignFile:
    """A file that a library of others reads; `hint` is what to do if it is damaged, a sentence.

    Only calls of the library belong into `call`: what our own code raises is a bug, and stays one.
    """

    def __init__(self, path: Path, hint: str = "") -> None:
        # place: where in the file the next call reads, such as `message 7 of /scan`
        self.path, self.place, self._hint = path, "", hint
        self._left: int | None = None

    @contextmanager
    def call(self) -> Iterator[None]:
        """Turns whatever the library raises into a ConversionError with the path and the place."""
        try:
            yield
        except SwarmdataError:
            raise
        except Exception as error:
            name, words = type(error).__name__, quoted(error)
            raise self.broken(f"{name}: {words}" if words else name) from error

    def each(self, items: Iterable[Item]) -> Iterator[Item]:
        """Yields the items of an iterable of the library; what it raises is turned as by `call`."""
        with self.call():
            iterator = iter(items)
        while True:
            with self.call():
                item = next(iterator, _END)
            if item is _END:
                return
            yield item  # type: ignore[misc]

    def take(self, n_bytes: int) -> None:
        """Counts unpacked bytes before they are held; ConversionError if they are far too many."""
        if self._left is None:
            self._left = max(FREE_BYTES, MOST_EXPANSION * self.path.stat().st_size)
        self._left -= n_bytes
        if self._left < 0:
            raise self.broken(
                f"it unfolds to more than {MOST_EXPANSION} times its size, the most allowed"
            )

    def broken(self, problem: str) -> ConversionError:
        """The error for a problem at the place."""
        place = f"{quoted(self.place)}: " if self.place else ""
        hint = f" {self._hint}" if self._hint else ""
        said = " ".join(f"{place}{problem.rstrip('. ')}.{hint}".split())
        return ConversionError(f"{self.path} cannot be read: {said}")


def reading(source: Path | str, hint: str = "") -> AbstractContextManager[None]:
    """`ForeignFile.call` for a single call of a library; the hint is what to do, a sentence."""
    return ForeignFile(Path(source), hint).call()


def check_stored(source: Path | str, declared: int, stored: int) -> None:
    """Raises ConversionError if far more bytes are declared than any packing explains."""
    if declared > FREE_ARRAY_BYTES + MOST_ARRAY_EXPANSION * stored:
        raise ConversionError(
            f"{source} declares {declared / 1e6:,.0f} MB, but stores {stored / 1e6:,.3f} MB, "
            f"expected at most {MOST_ARRAY_EXPANSION} bytes for a stored one: it is damaged, or "
            "made to fill the memory."
        )


def check_plain(source: Path) -> None:
    """Refuses what is neither a file nor a folder, and links in a folder that lead out of it.

    Otherwise a folder from the internet could name any file of this machine as its data.
    """
    if source.is_file():
        return
    if not source.is_dir():
        raise ConversionError(f"{source} is neither a file nor a folder, such as a pipe")
    root = os.path.realpath(source)
    for path in source.rglob("*"):  # realpath: it takes links that lead in a circle
        if path.is_symlink() and not Path(os.path.realpath(path)).is_relative_to(root):
            raise ConversionError(
                f"{path} is a symbolic link that leads out of {source}, expected plain files. Copy "
                "the folder with its content (cp -rL), or download it with local_dir=FOLDER."
            )
