"""What `verify` runs in a process: policies act; `python -m ... ENTRY OUT N THREADS`."""

import json
import resource
import sys
from pathlib import Path

from swarmdata.evaluation.leaderboard.entry import ENTRY, Description, entry_task, read_policy
from swarmdata.evaluation.leaderboard.verify import GIGABYTES, MEASURED, N_REPEATED, fresh_seeds
from swarmdata.numerics.random import block_seeds
from swarmdata.rollouts.evaluate import evaluate


def main(entry: Path, out: Path, n_episodes: int, n_threads: int) -> None:
    """Writes the metrics of every policy on all blocks of episodes, [K, E] each."""
    resource.setrlimit(resource.RLIMIT_AS, (GIGABYTES << 30, GIGABYTES << 30))
    description = Description.from_file(entry / ENTRY)
    spec = entry_task(description.dataset)
    policies = [read_policy(entry / file, spec) for file in description.files]
    blocks = {
        "reserved": block_seeds("evaluation", n_episodes),
        "fresh": fresh_seeds(description, n_episodes),
        "repeated": block_seeds("evaluation", min(n_episodes, N_REPEATED)),
    }
    measured = {
        name: [
            evaluate(policy, spec, seeds=seeds, n_threads=n_threads, progress=False).metrics
            for policy in policies
        ]
        for name, seeds in blocks.items()
    }
    found = {
        name: {metric: [each[metric].tolist() for each in metrics] for metric in metrics[0]}
        for name, metrics in measured.items()
    }
    (out / MEASURED).write_text(json.dumps(found))


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4]))
