"""Collects compiled kernels into the pack that a wheel has inside; `make wheel` runs it.

A pack is a folder for each digest of source (`kernels.digest_of`), with numba's files of it. It was
compiled for `kernel_cache.PACK_CPU`. Its files name the version of numba and of Python, the
operating system, and the hash of what was compiled: where one of them is another, nothing is found,
and kernels are compiled as without a pack.

    NUMBA_CPU_NAME=x86-64-v3 NUMBA_CPU_FEATURES= NUMBA_CACHE_DIR=kernels swarmdata warm
    python -m swarmdata.runtime.kernel_pack kernels OUT
"""

import shutil
import sys
from pathlib import Path


def gather(kernels: Path, out: Path) -> int:
    """Copies the files of a cache, `kernels/DIGEST/PLACE/file`, to `out/DIGEST/file`.

    Args:
        kernels: folder of a cache that was written for `PACK_CPU`.
        out: folder of the pack; it is made, and must not be there.

    Returns:
        How many compiled kernels there are.
    """
    out.mkdir(parents=True)
    files = sorted(kernels.glob("*/*/*.nb[ci]"))
    for file in files:
        folder = out / file.parent.parent.name
        folder.mkdir(exist_ok=True)
        shutil.copyfile(file, folder / file.name)
    return sum(file.suffix == ".nbc" for file in files)


if __name__ == "__main__":
    gather(*map(Path, sys.argv[1:]))
