"""Streaming from a web server on this machine: speed, and what a window costs in randomness.

    python -m tests.benchmarks.bench_streaming [--steps 500000] [--data coop_nav-expert]

Every way of reading runs in a fresh process, with a server in another one. Randomness is computed
from the episode table of a dataset, without reading any batch. Puts a section into
docs/measurements.md.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import numpy as np

from swarmdata.datasets.dataset import Dataset
from swarmdata.hub.catalog.catalog import load
from swarmdata.hub.streaming.streamed_dataset import Stream, StreamedDataset
from swarmdata.testing.synthetic import RELEASE_CARD
from tests.benchmarks.bench_load import size_of
from tests.benchmarks.large_dataset import make_large_dataset
from tests.benchmarks.measuring import short, table, write_section

ID = "coop_nav-synthetic-v0"
BATCH, N_BATCHES = 256, 1000
WINDOWS = (4, 8, 16, 32)
N_DRAWN = 2000
"""Batches whose randomness is measured."""

WAYS = {
    "stream, nothing kept yet": ("stream", "cold"),
    "stream, chunks in the cache": ("stream", "cold"),  # the cache of the row above
    "load: fetch everything, then read": ("load", "whole"),
    "load: the copy in the cache": ("load", "whole"),
}
"""By the first cell of their row: how data are opened, and the name of the cache's folder."""


def measure(way: str, url: str) -> dict[str, float]:
    """Reads batches in this process; the cache is that of the environment."""
    start = time.perf_counter()
    data: Dataset | StreamedDataset
    data = load(url, progress=False) if way == "load" else _streamed(url)
    sampler = data.split("train").sampler(BATCH)
    next(sampler)
    first = time.perf_counter() - start
    start, used = time.perf_counter(), time.process_time()
    for _ in range(N_BATCHES):
        next(sampler)
    seconds = time.perf_counter() - start
    return {
        "first": first,
        "rate": N_BATCHES / seconds,
        "core_rate": N_BATCHES / (time.process_time() - used),
    }


def _streamed(name: str, window: int = 16) -> StreamedDataset:
    return load(name, stream=Stream(window), progress=False)


@contextmanager
def served(folder: Path) -> Iterator[str]:
    """A server over a folder, in a process of its own; yields its address."""
    command = [sys.executable, "-m", "tests.benchmarks.range_server", str(folder)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None
        try:
            yield f"http://127.0.0.1:{server.stdout.readline().strip()}"
        finally:
            server.kill()


def in_fresh_process(way: str, url: str, cache: Path) -> dict[str, float]:
    """Measures one way of reading with a cache."""
    run = subprocess.run(
        [sys.executable, "-m", "tests.benchmarks.bench_streaming", "--one", way, url],
        stdout=subprocess.PIPE, text=True, check=True, timeout=3600,
        env={**os.environ, "SWARMDATA_CACHE": str(cache), "NO_PROXY": "127.0.0.1"},
    )  # fmt: skip
    found: dict[str, float] = json.loads(run.stdout.splitlines()[-1])
    return found


def speed(n_steps: int, folder: Path) -> str:
    """The table of ways of reading."""
    published = folder / "published"
    published.mkdir()
    make_large_dataset(published / ID, n_steps)
    (published / ID / "card.md").write_text(RELEASE_CARD)
    rows: list[tuple[str, ...]] = []
    with served(published) as address:
        for name, (way, cache) in WAYS.items():
            found = in_fresh_process(way, f"{address}/{ID}", folder / cache)
            print(name, json.dumps(found), file=sys.stderr, flush=True)
            kept = size_of(folder / cache)
            rows.append(
                (name, f"{found['first']:.2f}", short(found["rate"]), short(found["core_rate"]),
                 f"{kept / 1e6:,.0f}")
            )  # fmt: skip
    text = (
        f"Seconds until the first batch of {BATCH} transitions and then batches a second, over "
        f"{N_BATCHES:,} of them, with {n_steps:,} joint steps of 4 robots "
        f"({size_of(published / ID) / 1e6:,.0f} MB) from a web server on the same shared machine. "
        "Windows have 16 blocks. A real network takes longer.\n\n"
    )
    head = ("way", "first batch s", "batches / s", "batches / core s", "cache MB")
    return text + table(head, rows)


class Randomness(NamedTuple):
    """How far batches are from those that are drawn from all episodes.

    Episodes, policies and returns are those of the transitions of a batch, [B].
    """

    episodes: float  # different ones in a batch
    policies: float  # half of the summed differences of their shares from those in the data
    deviation: float  # of the batches' mean returns, over that of single transitions / sqrt(B)
    memory: float  # correlation of the mean returns of neighboring batches


def randomness(data: StreamedDataset, window: int) -> Randomness:
    """Measures batches that a window gives; 0: one of all blocks."""
    stream = Stream(window or len(data.blocks.firsts))
    view = StreamedDataset(data.blocks, data.selection, stream, data.references, data.source)
    sampler = view.split("train").sampler(BATCH, seed=0)
    table = data.blocks.table
    owners = np.repeat(np.arange(len(table)), table.lengths)
    drawn = owners[np.stack([sampler.draw() for _ in range(N_DRAWN)])]  # [batches, B]
    train = np.repeat(table.split == 0, table.lengths)
    every = owners[train]
    n_policies = int(table.policy.max()) + 1
    whole = np.bincount(table.policy[every], minlength=n_policies) / len(every)
    shares = np.stack([np.bincount(table.policy[k], minlength=n_policies) for k in drawn]) / BATCH
    means = table.team_return[drawn].mean(1)
    alone = table.team_return[every].std() / np.sqrt(BATCH)
    return Randomness(
        episodes=float(np.mean([len(np.unique(each)) for each in drawn])),
        policies=float(np.abs(shares - whole).sum(1).mean() / 2),
        deviation=float(np.std(means) / alone),
        memory=float(np.corrcoef(means[:-1], means[1:])[0, 1]),
    )


def lost(name: str) -> str:
    """The table of windows."""
    data = _streamed(name)
    n_blocks = len(data.blocks.firsts) - 1
    rows: list[tuple[str, ...]] = []
    for window in (*(each for each in WINDOWS if each < n_blocks), 0):
        found = randomness(data, window)
        rows.append(
            (str(window) if window else f"{n_blocks} (all)", f"{found.episodes:.0f}",
             f"{found.policies:.3f}", f"{found.deviation:.2f}", f"{found.memory:.2f}")
        )  # fmt: skip
    n_policies = len(np.unique(data.blocks.table.policy))
    text = (
        f"\nHow random are streamed batches? {N_DRAWN:,} batches of {BATCH} transitions of "
        f"`{data.id}` ({len(data):,} episodes, {n_policies} policies, {n_blocks} blocks), by "
        "blocks in the window: episodes in a batch; total variation between the batch's and the "
        "data's shares of policies; deviation of a batch's mean return, over that of independent "
        "samples; and correlation of the mean returns of consecutive batches.\n\n"
    )
    head = ("window", "episodes", "policies off", "deviation", "correlation")
    return text + table(head, rows)


def main(arguments: Sequence[str] | None = None) -> None:
    """Measures both, and writes the section."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--steps", type=int, default=500_000)
    parser.add_argument("--data", default="coop_nav-expert", help="whose order is measured")
    parser.add_argument("--only-print", action="store_true", help="leave docs/ alone")
    parser.add_argument("--one", nargs=2, metavar=("WAY", "URL"))
    given = parser.parse_args(arguments)
    if given.one:
        print(json.dumps(measure(*given.one)))
        return
    load(given.data)  # built where it is not on this machine
    with tempfile.TemporaryDirectory() as folder:
        body = speed(given.steps, Path(folder)) + lost(given.data)
    print(body)
    if not given.only_print:
        write_section("Streaming", body)


if __name__ == "__main__":
    main()
