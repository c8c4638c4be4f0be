"""Reads files with untrusted names, only if they are regular and of bounded size."""

import os
import stat
from pathlib import Path

from swarmdata.errors import FileKindError


def read_regular(path: Path, most_bytes: int, *, follow_links: bool = True) -> bytes:
    """Returns the bytes of a regular file.

    A device, a pipe or a file that grows neither blocks nor fills the memory. The path itself is no
    symbolic link unless `follow_links`.

    Raises:
        OSError: it cannot be opened.
        FileKindError: it is no regular file, or is larger; an `OSError` as well.
    """
    if not follow_links and path.is_symlink():
        raise FileKindError(f"{path} is a symbolic link, expected a regular file")
    check_regular(path)  # some that are not can hardly be opened
    flags = os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC | (0 if follow_links else os.O_NOFOLLOW)
    with open(path, "rb", opener=lambda name, _: os.open(name, flags)) as file:
        found = os.fstat(file.fileno())  # of what was opened, whatever happened in between
        check_regular(path, found)
        content = file.read(most_bytes + 1) if found.st_size <= most_bytes else None
    if content is None or len(content) > most_bytes:
        raise FileKindError(f"{path} has more than {most_bytes} bytes, which is the most allowed")
    return content


def check_regular(path: Path, found: os.stat_result | None = None) -> None:
    """Checks that a path, of which the system may have said what it is, leads to a regular file.

    Raises:
        OSError: there is none.
        FileKindError: it is something else.
    """
    mode = (found or path.stat()).st_mode
    if stat.S_ISREG(mode):
        return
    kinds = {
        stat.S_IFDIR: "a folder",
        stat.S_IFIFO: "a pipe",
        stat.S_IFSOCK: "a socket",
        stat.S_IFCHR: "a device",
        stat.S_IFBLK: "a device",
    }
    kind = kinds.get(stat.S_IFMT(mode), "no plain file")
    raise FileKindError(f"{path} is {kind}, expected a regular file")
