"""`swarmdata warm`: compiles kernels before they are needed."""

import typer

from swarmdata.cli.shared_options import Workers


def warm(workers: Workers = None) -> None:
    """Compile all kernels now, so that no later command waits for it.

    Meant for images and CI. Kernels are kept in SWARMDATA_CACHE, or NUMBA_CACHE_DIR if it is set,
    and are good for this version of swarmdata and numba and for this kind of CPU.
    """
    from swarmdata.building.kernel_warmup import kernel_folder, warm_kernels

    n_compiled = warm_kernels(workers=workers)
    typer.echo(f"{kernel_folder()}: {n_compiled} kernels compiled, none is left to do")
