"""Files that somebody else named, read only if they are regular and of bounded size."""

import os
import stat
from pathlib import Path


def read_regular(path: Path, most_bytes: int, *, follow_links: bool = True) -> bytes:
    """Returns the bytes of a regular file.

    What it is and how large is looked at before anything is read, and no more than `most_bytes`
    ever is: a device, a pipe or a file that grows neither blocks nor fills the memory.

    Args:
        path: of the file.
        most_bytes: that it may have.
        follow_links: whether `path` may be a symbolic link to such a file.

    Raises:
        OSError: it cannot be opened, is no regular file, or is larger.
    """
    flags = os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC | (0 if follow_links else os.O_NOFOLLOW)
    if not follow_links and path.is_symlink():
        raise OSError(f"{path} is a symbolic link, expected a regular file")
    if stat.S_ISSOCK(path.stat().st_mode):  # which cannot be opened
        raise OSError(f"{path} is a socket, expected a regular file")
    with os.fdopen(os.open(path, flags), "rb") as file:
        found = os.fstat(file.fileno())
        if not stat.S_ISREG(found.st_mode):
            raise OSError(f"{path} is {_kind(found.st_mode)}, expected a regular file")
        content = file.read(most_bytes + 1) if found.st_size <= most_bytes else None
    if content is None or len(content) > most_bytes:
        raise OSError(f"{path} has more than {most_bytes} bytes, which is the most allowed")
    return content


def _kind(mode: int) -> str:
    kinds = {
        "a folder": stat.S_ISDIR(mode),
        "a pipe": stat.S_ISFIFO(mode),
        "a device": stat.S_ISCHR(mode) or stat.S_ISBLK(mode),
    }
    return next((name for name, is_it in kinds.items() if is_it), "no plain file")
