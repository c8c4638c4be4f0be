"""Opening a dataset at each level of checking, against the machine's memory and peers' ways.

python tests/benchmarks/bench_load.py [n_steps] [folder]
"""

import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import zarr

from swarmdata.dataset import Dataset
from swarmdata.store.layout import FIELDS
from swarmdata.testing.synthetic import make_large_dataset


def best_of(run: Callable[[], object], repeats: int = 5) -> float:
    run()
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        run()
        times.append(time.perf_counter() - start)
    return min(times)


def main() -> None:
    n_steps = int(sys.argv[1]) if len(sys.argv) > 1 else 200_000
    with tempfile.TemporaryDirectory(dir=sys.argv[2] if len(sys.argv) > 2 else None) as folder:
        path = Path(folder) / "ds"
        start = time.perf_counter()
        make_large_dataset(path, n_steps)
        built = time.perf_counter() - start
        dataset = Dataset.open(path)
        arrays = {name: np.asarray(dataset.stored.arrays[name]) for name in FIELDS}
        n_bytes = sum(values.nbytes for values in arrays.values())
        targets = {name: np.empty_like(values) for name, values in arrays.items()}

        def copy() -> None:
            for name, values in arrays.items():
                np.copyto(targets[name], values)

        def read_zarr() -> None:
            group = zarr.open_group(path / "data.zarr", mode="r")
            for name in FIELDS:
                np.asarray(group[name][...])  # type: ignore[index]

        memcpy = best_of(copy)
        print(f"{dataset.n_steps} steps, {n_bytes / 1e6:.0f} MB; made in {built:.1f} s")
        speed = n_bytes / memcpy / 1e9
        print(f"{'memcpy of all arrays':24s} {1e3 * memcpy:9.2f} ms  {speed:.1f} GB/s")
        for name, run in {
            "open, verify='none'": lambda: Dataset.open(path, "none"),
            "open, verify='fast'": lambda: Dataset.open(path, "fast"),
            "open, verify='full'": lambda: Dataset.open(path, "full"),
            "zarr-python, read all": read_zarr,
        }.items():
            seconds = best_of(run, 3)
            print(f"{name:24s} {1e3 * seconds:9.2f} ms  {seconds / memcpy:6.2f} x memcpy")
        episode = best_of(lambda: [dataset[i] for i in range(1000)])
        print(f"{'ds[i], one episode':24s} {1e3 * episode / 1000:9.4f} ms")


if __name__ == "__main__":
    main()
