"""Loading 600 MB on one core: ours at each level of checking, and peers' formats of one content.

    python -m tests.benchmarks.bench_load [n_steps] [folder]

Every load runs in a new process on one core, in turns; files are in the page cache; imports are not
counted. Memory is what the process holds more at its peak than before the load; of that, private
memory is what the system cannot take back. Puts the table into docs/measurements.md.
"""

import json
import os
import sys
import tempfile
import time
from importlib.util import find_spec
from pathlib import Path

from swarmdata.datasets.dataset import Dataset
from tests.benchmarks.large_dataset import make_large_dataset
from tests.benchmarks.load_formats import FORMATS, MINARI, OURS
from tests.benchmarks.measuring import table, write_section
from tests.support.interpreter import python

N_STEPS = 560_000
"""Joint steps of the default: 600 MB."""

ROUNDS = 3


def memory(what: str) -> float:
    """One line of this process's status, in bytes: VmRSS, VmHWM (its peak) or RssAnon."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(1024.0 * int(line.split()[1]) for line in lines if line.startswith(f"{what}:"))


def measure(name: str, path: Path) -> dict[str, float]:
    """Loads once, in this process, on one core."""
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    kind = FORMATS[name]
    for package in kind.packages:
        __import__(package)
    resident, private = memory("VmRSS"), memory("RssAnon")
    start, used = time.perf_counter(), time.process_time()
    loaded = kind.load(path)
    found = {
        "seconds": time.perf_counter() - start,
        "processor": time.process_time() - used,
        "peak": memory("VmHWM") - resident,
        "private": memory("RssAnon") - private,
    }
    del loaded
    return found


def size_of(path: Path) -> int:
    files = path.rglob("*") if path.is_dir() else [path]
    return sum(file.stat().st_size for file in files if file.is_file())


def in_fresh_process(name: str, path: Path) -> dict[str, float]:
    run = python("-m", "tests.benchmarks.bench_load", "--one", name, path, timeout=600)
    result: dict[str, float] = json.loads(run.stdout.splitlines()[-1])
    return result


def compare(folder: Path, names: list[str]) -> str:
    rounds = [
        {name: in_fresh_process(name, folder / FORMATS[name].file) for name in names}
        for _ in range(ROUNDS)
    ]
    medians = {
        name: {
            key: sorted(found[name][key] for found in rounds)[ROUNDS // 2]
            for key in ("seconds", "processor", "peak", "private")
        }
        for name in names
    }
    verified = medians["swarmdata, verify='fast'"]["processor"]
    rows: list[tuple[str, ...]] = [
        (
            name,
            f"{found['processor']:.4f}",
            f"{found['processor'] / verified:.3g}",
            f"{found['seconds']:.4f}",
            f"{found['peak'] / 1e6:,.0f}",
            f"{found['private'] / 1e6:,.0f}",
            f"{size_of(folder / FORMATS[name].file) / 1e6:,.0f}",
            FORMATS[name].note,
        )
        for name, found in medians.items()
    ]
    head = (
        "format", "core s", "ratio", "wall s", "peak MB", "private MB", "on disk MB", "what it is",
    )  # fmt: skip
    return table(head, rows)


def main(n_steps: int, folder: Path) -> None:
    os.environ.setdefault("MINARI_DATASETS_PATH", str(folder / MINARI))
    make_large_dataset(folder / OURS, n_steps)
    dataset = Dataset.open(folder / OURS)
    names = []
    for name, kind in FORMATS.items():
        absent = [package for package in kind.packages if find_spec(package) is None]
        if absent:
            print(f"{name} is left out: {', '.join(absent)} not installed", file=sys.stderr)
            continue
        start = time.perf_counter()
        kind.write(dataset, folder / kind.file)
        print(f"{name}: written in {time.perf_counter() - start:.1f} s", file=sys.stderr)
        names.append(name)
    body = compare(folder, names)
    print(body)
    text = (
        f"Loading {dataset.n_steps:,} joint steps of 4 robots, "
        f"{size_of(folder / OURS) / 1e6:,.0f} MB of random numbers, with a warm page cache: "
        f"medians of {ROUNDS} fresh processes on a shared machine. Core seconds are processor "
        "time. Ratios are to ours with every chunk verified. Private memory cannot be reclaimed "
        "by the system.\n\n"
    )
    write_section("Loading", text + body)


if __name__ == "__main__":
    if sys.argv[1:2] == ["--one"]:
        print(json.dumps(measure(sys.argv[2], Path(sys.argv[3]))))
    else:
        with tempfile.TemporaryDirectory(dir=sys.argv[2] if len(sys.argv) > 2 else None) as name:
            main(int(sys.argv[1]) if len(sys.argv) > 1 else N_STEPS, Path(name))
