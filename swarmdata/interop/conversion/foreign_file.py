"""ForeignFile: a file of others, whose every failure in a library that reads it is one error."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar

from swarmdata.errors import ConversionError, SwarmdataError

MOST_WORDS = 200
"""Characters of a library's message that an error repeats."""

FREE_BYTES = 1 << 28
"""Bytes that any file may unfold to."""

MOST_EXPANSION = 200
"""Bytes that a larger file may unfold to for each of its own. Logs of robots at rest reach 100."""

Item = TypeVar("Item")

_END = object()


def printable(text: str) -> str:
    """Text of a file on one line, without characters that would control a terminal."""
    return "".join(each if each.isprintable() else "?" for each in text)


class ForeignFile:
    """A file that a library of others reads.

    Only calls of the library belong into `call`: what our own code raises is a bug, and stays one.

    Args:
        path: of the file.
        hint: what a user can do about a damaged file, a sentence.

    Attributes:
        path: of the file.
        place: where in the file the next call reads, such as `message 7 of /scan`.
    """

    def __init__(self, path: Path, hint: str = "") -> None:
        self.path, self.place, self._hint = path, "", hint
        self._left: int | None = None

    @contextmanager
    def call(self) -> Iterator[None]:
        """Turns whatever the library raises into an error with the path and the place.

        Raises:
            ConversionError: the library failed; errors of ours pass.
        """
        try:
            yield
        except SwarmdataError:
            raise
        except Exception as error:
            name, words = type(error).__name__, str(error).strip()
            raise self.broken(f"{name}: {words:.{MOST_WORDS}}" if words else name) from error

    def each(self, items: Iterable[Item]) -> Iterator[Item]:
        """Yields the items of an iterable of the library; what it raises is turned as by `call`.

        Raises:
            ConversionError: the library failed.
        """
        with self.call():
            iterator = iter(items)
        while True:
            with self.call():
                item = next(iterator, _END)
            if item is _END:
                return
            yield item  # type: ignore[misc]

    def take(self, n_bytes: int) -> None:
        """Counts bytes that the file declares, or that are unpacked of it, before they are held.

        Raises:
            ConversionError: the file unfolds to far more than it holds.
        """
        if self._left is None:
            self._left = max(FREE_BYTES, MOST_EXPANSION * self.path.stat().st_size)
        self._left -= n_bytes
        if self._left < 0:
            raise self.broken(
                f"it unfolds to more than {MOST_EXPANSION} times its size, the most allowed"
            )

    def broken(self, problem: str) -> ConversionError:
        """The error for a problem at the place."""
        place = f"{self.place}: " if self.place else ""
        hint = f" {self._hint}" if self._hint else ""
        said = printable(f"{place}{problem.rstrip('. ')}.{hint}")
        return ConversionError(f"{self.path} cannot be read: {said}")
