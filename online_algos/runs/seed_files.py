"""Paths and loading of the policies that online runs save for each seed."""

from pathlib import Path

from swarmdata.errors import BuildError
from swarmdata.interfaces import Policy
from swarmdata.learn.policies.policy_file import load_policy
from swarmdata.learn.training.run_files import POLICIES, policy_folder, saved_policies


def policy_path(folder: Path, seed: int, frames: int) -> Path:
    """Where a run keeps the policy of a seed at a checkpoint."""
    return policy_folder(folder, seed) / f"{frames:010d}.safetensors"


def last_policy_path(folder: Path, seed: int) -> Path:
    """The newest policy of a seed.

    Raises:
        BuildError: the run has not reached a checkpoint yet.
    """
    found = saved_frames(folder, seed)
    if not found:
        raise BuildError(
            f"{folder} has no policy of seed {seed} yet; wait for its first checkpoint"
        )
    return policy_path(folder, seed, found[-1])


def saved_frames(folder: Path, seed: int) -> list[int]:
    """Frames at which a run kept policies of a seed, in order."""
    return [int(file.stem) for file in saved_policies(folder, seed)]


def last_policy(run: Path, seed: int) -> Policy:
    """The newest policy of a seed of a run, or of one of the runs inside a folder.

    Raises:
        BuildError: there is none.
    """
    inside = sorted(run.glob(f"seeds-*/{POLICIES}/seed-{seed}"))
    folder = inside[0].parent.parent if inside else run
    return load_policy(last_policy_path(folder, seed))
