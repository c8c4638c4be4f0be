"""Which files of a run folder hold the policies that are measured, and their common digest.

Needs no torch: whoever reads results can tell whether the run beside them is still the same.
"""

import hashlib
from pathlib import Path

from swarmdata.runtime.documents import read_document

CONFIG, CHECKPOINT, POLICIES = "config.json", "checkpoint.safetensors", "policies"
"""As `learn.run` and `online_algos.run_folder` write them."""


def run_folders(folder: Path) -> tuple[Path, ...]:
    """The run that a folder is, or those of several processes inside it; empty for another one."""
    inside = sorted(folder.glob(f"seeds-*/{CONFIG}"))
    files = [folder / CONFIG] if (folder / CONFIG).exists() else inside
    return tuple(file.parent for file in files)


def is_online(folder: Path) -> bool:
    """Whether a run folder is of online training: one that learned from no dataset.

    Algorithms do not tell: `vdn` and `qmix` are names of both kinds.
    """
    config = folder / CONFIG
    return config.exists() and "dataset" not in read_document(config)


def measured_files(folder: Path, seed: int) -> tuple[Path, ...]:
    """The files that decide what a seed's policy does: of an online run its newest policy.

    Args:
        folder: of the run.
        seed: of the training.
    """
    config = folder / CONFIG
    if not is_online(folder):
        return config, folder / CHECKPOINT
    saved = sorted((folder / POLICIES / f"seed-{seed}").glob("*.safetensors"))
    return config, *saved[-1:]


def run_hash(folder: Path, seed: int) -> str:
    """SHA-256 of the names and contents of the measured files, hex; an absent one counts as such.

    It changes with the configuration, the dataset's digest, and every update of the training.
    """
    total = hashlib.sha256()
    for file in measured_files(folder, seed):
        total.update(f"{file.relative_to(folder).as_posix()}\n".encode())
        content = file.read_bytes() if file.exists() else b""
        total.update(hashlib.sha256(content).digest())
    return total.hexdigest()
