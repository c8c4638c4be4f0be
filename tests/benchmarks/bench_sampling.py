"""Sampling batches, against a copy of the same bytes and a plain fancy-index sampler.

python -m tests.benchmarks.bench_sampling [n_steps]
"""

import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from swarmdata.datasets.dataset import Dataset
from swarmdata.testing.synthetic import make_large_dataset
from tests.benchmarks.batch_peers import n_bytes


def best_of(run: Callable[[], object], seconds: float = 1.5, inner: int = 20) -> float:
    run()
    best, end = float("inf"), time.perf_counter() + seconds
    while time.perf_counter() < end:
        start = time.perf_counter()
        for _ in range(inner):
            run()
        best = min(best, (time.perf_counter() - start) / inner)
    return best


def naive(dataset: Dataset, batch_size: int) -> Callable[[], object]:
    """What users write: fancy indexing of every field, with a NumPy generator."""
    arrays = dataset.stored.arrays
    rng = np.random.default_rng(0)
    episode = np.repeat(np.arange(len(dataset)), dataset.episodes.lengths)

    def run() -> object:
        index = rng.integers(0, dataset.n_steps, batch_size)
        here = index + episode[index]
        fields = [arrays[name][here] for name in ("observations", "states")]
        fields += [arrays[name][here + 1] for name in ("observations", "states")]
        names = ("actions", "rewards", "terminations", "truncations")
        return fields + [arrays[name][index] for name in names]

    return run


def main() -> None:
    n_steps = int(sys.argv[1]) if len(sys.argv) > 1 else 1_000_000
    with tempfile.TemporaryDirectory() as folder:
        make_large_dataset(Path(folder) / "ds", n_steps)
        dataset = Dataset.open(Path(folder) / "ds")
        for batch_size, horizon in ((256, None), (4096, None), (64, 20)):
            sampler = dataset.sampler(batch_size, horizon=horizon)
            size = n_bytes(next(sampler))
            block = np.ones(size, dtype=np.uint8)
            target = np.empty_like(block)
            memcpy = best_of(lambda: np.copyto(target, block))  # noqa: B023
            steps = batch_size * (horizon or 1)
            print(f"batch {batch_size}, horizon {horizon}: {size / 1e3:.0f} kB")
            print(f"  {'copy':18s} {memcpy * 1e6:8.1f} us")
            runs = {"sampler": lambda: next(sampler), "draw only": sampler.draw}  # noqa: B023
            if horizon is None:
                runs["naive fancy index"] = naive(dataset, batch_size)
            for name, run in runs.items():
                each = best_of(run)
                print(
                    f"  {name:18s} {each * 1e6:8.1f} us  {steps / each / 1e6:6.2f} M steps/s  "
                    f"{size / each / 1e9:5.1f} GB/s  {each / memcpy:5.1f} x copy"
                )


if __name__ == "__main__":
    main()
