"""Peak memory and time of everything that reads a whole dataset, on datasets of several sizes.

    python -m tests.benchmarks.bench_memory_use --sizes 1M 5M 200k-episodes

Every operation runs in a fresh process. Memory is the process's peak of resident memory (VmHWM):
pages of mapped files count, and so does what Python and the libraries take. The table goes into
docs/measurements.md.
"""

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

from tests.benchmarks.bench_load import memory, size_of
from tests.benchmarks.measuring import table, write_section
from tests.benchmarks.memory_operations import OPERATIONS, SIZES, make

KEPT = {"to HDF5"}
"""Operations whose result is read by the next one."""


def measure(operation: str, data: Path, out: Path) -> dict[str, float]:
    """Runs an operation in this process."""
    start, used = time.perf_counter(), time.process_time()
    OPERATIONS[operation](data, out)
    return {
        "seconds": time.perf_counter() - start,
        "processor": time.process_time() - used,
        "peak": memory("VmHWM"),
    }


def in_fresh_process(operation: str, data: Path, out: Path) -> dict[str, float]:
    """Runs an operation in a process of its own."""
    run = subprocess.run(
        [sys.executable, "-m", "tests.benchmarks.bench_memory_use",
         "--one", operation, str(data), str(out)],
        stdout=subprocess.PIPE, text=True, check=True, timeout=7200,
    )  # fmt: skip
    result: dict[str, float] = json.loads(run.stdout.splitlines()[-1])
    return result


def measure_size(name: str, operations: Sequence[str], folder: Path) -> dict[str, dict[str, float]]:
    """Measures operations on one dataset, and deletes it."""
    data, out = folder / name, folder / f"{name}-out"
    make(name, data)
    out.mkdir()
    found = {"": {"peak": float(size_of(data)), "seconds": 0.0, "processor": 0.0}}
    for operation in operations:
        found[operation] = in_fresh_process(operation, data, out)
        print(name, operation, json.dumps(found[operation]), flush=True)
        for path in out.iterdir() if operation not in KEPT else ():
            shutil.rmtree(path) if path.is_dir() else path.unlink()
    shutil.rmtree(data)
    shutil.rmtree(out)
    return found


def text(found: Mapping[str, Mapping[str, Mapping[str, float]]]) -> str:
    """The section of docs/measurements.md."""
    sizes = "; ".join(
        f"`{name}`: {SIZES[name].n_steps:,} joint steps in {SIZES[name].n_episodes:,} episodes, "
        f"{each['']['peak'] / 1e9:.2f} GB"
        for name, each in found.items()
    )
    operations = [key for key in OPERATIONS if any(key in each for each in found.values())]
    rows = [
        (operation, *(_cell(each.get(operation)) for each in found.values()))
        for operation in operations
    ]
    return (
        "Peak of resident memory, pages of mapped files and everything else included, and "
        f"processor time, each in a fresh process on random numbers. {sizes} "
        "(`python -m tests.benchmarks.bench_memory_use`).\n\n"
        + table(("operation", *(f"`{name}`, GB / s" for name in found)), rows)
    )


def _cell(found: Mapping[str, float] | None) -> str:
    return "" if found is None else f"{found['peak'] / 1e9:.2f} / {found['processor']:.0f}"


def main(arguments: Sequence[str] | None = None) -> None:
    """Measures what is asked for, and writes the section."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--sizes", nargs="+", default=("1M", "200k-episodes"), choices=tuple(SIZES))
    parser.add_argument("--operations", nargs="+", default=tuple(OPERATIONS), choices=OPERATIONS)
    parser.add_argument("--folder", help="where datasets are written and deleted again")
    parser.add_argument("--only-print", action="store_true", help="leave docs/ alone")
    parser.add_argument("--one", nargs=3, metavar=("OPERATION", "DATA", "OUT"))
    given = parser.parse_args(arguments)
    if given.one:
        operation, data, out = given.one
        print(json.dumps(measure(operation, Path(data), Path(out))))
        return
    with tempfile.TemporaryDirectory(dir=given.folder) as folder:
        found = {name: measure_size(name, given.operations, Path(folder)) for name in given.sizes}
    body = text(found)
    print(body)
    if not given.only_print:
        write_section("Memory of large datasets", body)


if __name__ == "__main__":
    main()
