"""Mounts and networks of one's own: what a forked process does there, nobody else sees."""

import ctypes
import os
import subprocess
from pathlib import Path

CLONE_NEWNS, CLONE_NEWUSER, CLONE_NEWNET = 0x20000, 0x10000000, 0x40000000
"""Of unshare(2)."""


def enter(kind: int) -> None:
    """Makes this process root of a namespace; it may have one thread only.

    Raises:
        OSError: the system refuses it.
    """
    user, group = os.getuid(), os.getgid()
    if ctypes.CDLL(None, use_errno=True).unshare(CLONE_NEWUSER | kind):
        raise OSError(ctypes.get_errno(), "unshare")
    for file, text in (
        ("setgroups", "deny"),
        ("uid_map", f"0 {user} 1"),
        ("gid_map", f"0 {group} 1"),
    ):
        Path("/proc/self", file).write_text(text)
    if kind == CLONE_NEWNS:
        subprocess.run(["mount", "--make-rprivate", "/"], check=True)
