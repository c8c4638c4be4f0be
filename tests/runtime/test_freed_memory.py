"""Freed memory is used again without new pages."""

import platform
import subprocess
import sys

import pytest

COUNT = """
import resource
from swarmdata.runtime.freed_memory import keep_freed_memory

def count():
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    for _ in range(4):
        [b"x" * (20 << 20) for _ in range(4)]
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before

if {keeps}:
    assert keep_freed_memory()
count()
print(count())
"""


def new_pages(*, keeps: bool) -> int:
    """New pages of a process that takes and frees 80 MiB four times, after it did so before."""
    command = [sys.executable, "-c", COUNT.format(keeps=keeps)]
    return int(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="it is about glibc's allocator")
def test_freed_memory_is_used_again_without_new_pages() -> None:
    assert new_pages(keeps=True) < new_pages(keeps=False) / 10
