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
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from swarmdata.audit.checks import audit
from swarmdata.building.edit import subsample_dataset
from swarmdata.cards.sections.measured_content import measure as measure_content
from swarmdata.datasets.dataset import Dataset
from swarmdata.interop.convert import import_dataset
from swarmdata.interop.export import export_dataset
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.store import open_store
from swarmdata.store.assembly import assemble
from swarmdata.store.damage import find_damage
from swarmdata.store.episode_order import merge_order
from swarmdata.store.parts import write_part
from swarmdata.testing.synthetic import SPEC, make_episode, make_recipe
from tests.benchmarks.bench_load import memory, size_of
from tests.benchmarks.measuring import table, write_section

PER_PART = 256
"""Episodes of a part."""


class Size(NamedTuple):
    """How large a dataset is."""

    n_episodes: int
    length: int  # joint steps of each episode
    spec: TaskSpec = SPEC  # two robots, a quarter of a kilobyte a step
    shapes: Mapping[str, int] = {}  # of `make_episode`

    @property
    def n_steps(self) -> int:
        """Joint steps."""
        return self.n_episodes * self.length


FOUR_ROBOTS = {"n_agents": 4, "n_features": 53, "n_states": 32, "n_values": 0, "n_obstacles": 6}
"""A kilobyte a step, as in the published datasets."""

SIZES = {
    "1M": Size(8_000, 125, TaskSpec(), FOUR_ROBOTS),
    "5M": Size(40_000, 125, TaskSpec(), FOUR_ROBOTS),
    "20M": Size(160_000, 125, TaskSpec(), FOUR_ROBOTS),
    "200k-episodes": Size(200_000, 25),
    "tiny": Size(40, 25),
}
"""Datasets by the name of their column."""

OPERATIONS: dict[str, Callable[[Path, Path], object]] = {
    "load": lambda data, out: open_store(data, "fast"),
    "transitions()": lambda data, out: Dataset.open(data, "none").transitions(),
    "reobserve": lambda data, out: (
        Dataset.open(data, "none").reobserve("lidar-8", progress=False).moments
    ),
    "audit": lambda data, out: audit(data, progress=False),
    "verify": lambda data, out: (open_store(data, "full"), find_damage(data)),
    "card": lambda data, out: measure_content(open_store(data, "none")),
    "to HDF5": lambda data, out: export_dataset(
        Dataset.open(data, "none"), out / "flat.hdf5", format="d4rl"
    ),
    "from HDF5": lambda data, out: import_dataset(
        out / "flat.hdf5", out / "imported", format="d4rl", id="coop_nav-imported-v0"
    ),
    "to Parquet": lambda data, out: export_dataset(
        Dataset.open(data, "none"), out / "rows", format="parquet"
    ),
    "subsample": lambda data, out: subsample_dataset(
        Dataset.open(data, "none"), out / "smaller", id="coop_nav-smaller-v0",
        n_steps=open_store(data, "none").manifest.n_steps // 10,
    ),
}  # fmt: skip
"""By the first cell of their row; each takes a dataset and a folder for what it writes."""

KEPT = {"to HDF5"}
"""Operations whose result is read by the next one."""


def make(name: str, out: Path) -> None:
    """Writes a dataset of random numbers."""
    size = SIZES[name]
    parts = []
    for first in range(0, size.n_episodes, PER_PART):
        seeds = range(first, min(first + PER_PART, size.n_episodes))
        parts.append(out.parent / f"{name}-part-{first:06d}")
        write_part(parts[-1], [make_episode(size.length, seed, **size.shapes) for seed in seeds])
    recipe = make_recipe(size.n_steps, spec=size.spec)
    order = merge_order(recipe, [[size.length] * size.n_episodes]).order
    assemble(out, recipe=recipe, parts={0: parts}, order=order, consume=True)


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
