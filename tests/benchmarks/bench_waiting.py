"""What weighted cloning commands where clones of experts wait, `intersection-strict-expert`.

    python -m tests.benchmarks.bench_waiting runs/study-weights/cells

Means over the seeds of a study's runs, in units of the largest command, on the states of the first
200 validation episodes: rows in which the mean of the clones (`iql-beta-0`) commands less than 0.3
forward, and the others.
"""

import sys
from pathlib import Path
from typing import Any

import numpy as np

import swarmdata
from swarmdata.types import Float

CLONE = "iql-beta-0"
SLOW = 0.3


def forward(cells: Path, label: str, observations: Float) -> Float:
    """The forward commands of each seed's policy, [K, n, N]."""
    run = cells / label / "intersection-strict-expert" / label
    policies: list[Any] = [swarmdata.make_policy(str(run), seed=seed) for seed in range(5)]
    return np.stack([policy.actions(observations)[..., 0] for policy in policies])


def main(cells: Path) -> None:
    """Prints a table with a row for each label."""
    dataset = swarmdata.load("intersection-strict-expert").split("validation")
    episodes = [dataset[k] for k in range(200)]
    observations = np.concatenate([each.observations[:-1] for each in episodes])
    recorded = np.concatenate([each.actions[..., 0] for each in episodes])
    waits = forward(cells, CLONE, observations).mean(0) < SLOW
    print(f"| | clones wait ({waits.mean():.1%} of rows) | the other rows |")
    print("|---|---:|---:|")
    print(f"| data | {recorded[waits].mean():.3f} | {recorded[~waits].mean():.3f} |")
    for label in sorted(each.name for each in cells.iterdir()):
        seeds = forward(cells, label, observations)
        means = [[seed[rows].mean() for seed in seeds] for rows in (waits, ~waits)]
        shown = [f"{np.mean(each):.3f} ({min(each):.3f} to {max(each):.3f})" for each in means]
        print(f"| `{label}` | {shown[0]} | {shown[1]} |")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
