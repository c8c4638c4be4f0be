"""Collects compiled kernels for `kernel_cache.PACK_CPU` into a wheel; `make wheel` runs it."""

import shutil
import sys
from collections.abc import Iterable
from pathlib import Path

from swarmdata.building.kernel_warmup import kept_kernels, use_kernels
from swarmdata.errors import BuildError

SUFFIX = ".nbc"  # of numba's files of compiled code


def make_pack(out: Path) -> None:
    """Makes the pack, a new folder, of the kernels that Python calls when everything is used.

    The process that calls this notes the files that it opens until it ends.

    Raises:
        BuildError: a kernel was not compiled yet.
    """
    opened: set[Path] = set()

    def note(event: str, arguments: tuple[object, ...]) -> None:
        if event == "open" and str(arguments[0]).endswith(SUFFIX):
            opened.add(Path(str(arguments[0])))

    before = kept_kernels()
    sys.addaudithook(note)
    use_kernels()
    if n_new := len(kept_kernels() - before):
        raise BuildError(
            f"{n_new} kernels were not compiled before the pack was made, expected 0. Run "
            "`swarmdata warm` first, with the same NUMBA_... variables."
        )
    gather(tuple(opened), out)  # which opens them again


def gather(kernels: Iterable[Path], out: Path) -> None:
    """Copies kernels for `PACK_CPU`, `DIGEST/PLACE/file`, and their indices to `out/DIGEST`."""
    out.mkdir(parents=True)
    for kernel in kernels:
        folder = out / kernel.parent.parent.name
        folder.mkdir(exist_ok=True)
        function = kernel.stem.rpartition(".")[0]  # numba numbers the types that it compiles for
        for file in (kernel, kernel.with_name(f"{function}.nbi")):
            shutil.copyfile(file, folder / file.name)


if __name__ == "__main__":
    make_pack(Path(sys.argv[1]))
