"""A finished run without what it needs only to go on: its policies in small files of their own."""

from pathlib import Path

from swarmdata.learn.policy_file import load_policy, save_policy
from swarmdata.learn.run import CHECKPOINT, POLICIES, load_run, policy_path, read_run


def compact(folder: Path) -> None:
    """Replaces a finished run's checkpoint by the policies of its seeds; `load_run` reads them.

    A checkpoint holds critics, targets and Adam's moments of all seeds as well. The run cannot be
    continued afterwards. Killed in the middle, it can be called again.

    Raises:
        CheckpointError: the folder holds no run, or a damaged one.
    """
    if not (folder / CHECKPOINT).exists() and (folder / POLICIES).exists():
        return
    run = read_run(folder)
    for seed, policy in zip(run.seeds, load_run(folder), strict=True):
        save_policy(policy_path(folder, seed), policy)
        load_policy(policy_path(folder, seed))  # before the only other copy goes
    (folder / CHECKPOINT).unlink()
