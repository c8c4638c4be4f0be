"""Time and rate of re-observing a million recorded steps of `coop_nav` through other models.

    OMP_NUM_THREADS=1 python tests/benchmarks/bench_reobserve.py [steps]

The goal is under 5 s for a million steps from `state` to `lidar` (16 rays) on one core. Episodes
are rollouts of the scripted policy, repeated until there are enough steps, so that states, layouts
and lengths are real; the arrays lie in memory, as those of a dataset do once they were read. Of
three times the first may include what a virtual machine needs to get its memory from the host.
"""

import platform
import sys
import time

import numpy as np

from swarmdata.datasets.reobservation import RecordedEpisodes, observe_episodes
from swarmdata.registry.components import make_env, make_policy, make_task
from swarmdata.registry.presets import preset
from swarmdata.rollouts.rollout import rollout
from swarmdata.specs.model_choice import with_models

GOAL = 5.0
"""Seconds for a million steps to lidar."""

REPEATS = 3

PAIRS = (
    ("state", "none"),
    ("lidar", "none"),
    ("bearing", "none"),
    ("occupancy", "none"),
    ("lidar+noise-0.05+dropout-0.1", "none"),
    ("lidar+stack-4", "none"),
    ("state", "lossy-30"),
    ("lidar", "lossy-30"),
)


def make_episodes(n_steps: int) -> RecordedEpisodes:
    """Episodes of at least `n_steps` joint steps."""
    spec = preset("coop_nav")
    seeds = np.arange(512, dtype=np.uint64)
    episodes = list(rollout(make_env(spec, 256), make_policy("scripted", spec), seeds))
    n_repeats = -(-n_steps // sum(map(len, episodes)))
    lengths = np.tile([len(episode) for episode in episodes], n_repeats)
    return RecordedEpisodes(
        states=np.tile(np.concatenate([e.states for e in episodes]), (n_repeats, 1)),
        actions=np.tile(np.concatenate([e.actions for e in episodes]), (n_repeats, 1, 1)),
        starts=np.cumsum(lengths) - lengths,
        lengths=lengths,
        seeds=np.tile(seeds, n_repeats),
        layouts=np.tile(np.stack([e.layout for e in episodes]), (n_repeats, 1, 1)),
    )


def main(n_steps: int) -> None:
    """Prints one line per pair of models."""
    episodes = make_episodes(n_steps)
    n = int(episodes.lengths.sum())
    small = RecordedEpisodes(episodes.states, episodes.actions, *(
        getattr(episodes, name)[:8] for name in ("starts", "lengths", "seeds", "layouts")
    ))  # fmt: skip
    print(f"python {platform.python_version()}, {n:,} steps, {len(episodes.lengths):,} episodes")
    for observation, communication in PAIRS:
        task = make_task(with_models(preset("coop_nav"), observation, communication))
        observe_episodes(task, small, progress=False)  # compiles
        times = []
        for _ in range(REPEATS):
            start = time.perf_counter()
            arrays = observe_episodes(task, episodes, progress=False)
            times.append((time.perf_counter() - start) * 1e6 / n)
            size = sum(array.nbytes for array in arrays.values()) / n * 1e6
            del arrays
        verdict = f", goal {GOAL:g} s" if (observation, communication) == PAIRS[1] else ""
        print(
            f"{observation + ', ' + communication:38} first {times[0]:5.2f} s, best "
            f"{min(times):5.2f} s per million steps, {size / 1e9:.2f} GB{verdict}"
        )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 1_000_000)
