"""Files of others: what is refused before a library opens them, and whatever it raises as ours."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from swarmdata.errors import ConversionError, SwarmdataError

MOST_EXPANSION = 2000
"""Most bytes in memory for a stored one: twice what gzip packs at best."""

FREE_BYTES = 16 << 20
"""Bytes that may be declared without being stored, such as flags that were never set."""


@contextmanager
def reading(source: Path | str, hint: str = "") -> Iterator[None]:
    """Turns whatever another library raises about a file into one error of ours.

    Only calls of that library belong inside, so that no fault of our own code is hidden.

    Args:
        source: what is read, for the message.
        hint: what to do, a sentence.

    Raises:
        ConversionError: the library could not read it.
    """
    try:
        yield
    except SwarmdataError:
        raise
    except Exception as error:  # libraries raise anything about damaged files
        words = " ".join(str(error).split())[:300]
        raise ConversionError(
            f"{source} cannot be read: {type(error).__name__}: {words}.{' ' if hint else ''}{hint}"
        ) from error


def check_stored(source: Path | str, declared: int, stored: int) -> None:
    """Compares the size that a file says with what it holds, before memory is taken.

    Args:
        source: the file, or an array in it.
        declared: bytes in memory.
        stored: bytes on the disk.

    Raises:
        ConversionError: far more is declared than any compression explains.
    """
    if declared > FREE_BYTES + MOST_EXPANSION * stored:
        raise ConversionError(
            f"{source} declares {declared / 1e6:,.0f} MB, but stores {stored / 1e6:,.3f} MB, "
            f"expected at most {MOST_EXPANSION} bytes for a stored one: it is damaged, or made to "
            "fill the memory."
        )


def check_plain(source: Path) -> None:
    """Refuses what is neither a file nor a folder, and links in a folder that lead out of it.

    Otherwise a folder from the internet could name any file of this machine as its data.

    Raises:
        ConversionError: naming the path.
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


def folder_bytes(folder: Path) -> int:
    """Bytes of all files of a folder."""
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
