"""The files of a run folder, and a hash of those that decide what its policies do.

config.json             the run, completely: `OfflineRun` or `OnlineRun`
curve.csv               learning curve: metrics of each seed at each evaluation; online, its losses
checkpoint.safetensors  all seeds: parameters, optimizers, generators, samplers; or, of a finished
                        run that `training.compact` shrank, only what its policies need
seeds-*/                runs of several processes, each a run folder with a share of the seeds

Of offline runs also:

losses.csv              mean losses of each seed, every `log_every` updates
checkpoints/            earlier checkpoints by update, if the run was told to keep them

And of online runs:

policies/seed-N/        policies by joint steps, more of them than checkpoints
speed.csv               time, joint steps a second and memory at every checkpoint
tensorboard/seed-N/     the curve as TensorBoard event files
replay/                 transitions of an algorithm with a replay, until the run is finished

Needs no torch, so that a report can tell whether a run has changed since it was measured.
"""

import csv
import hashlib
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import NamedTuple

from swarmdata.errors import BuildError, UnknownNameError
from swarmdata.runtime.documents import read_document
from swarmdata.runtime.outside_names import is_folder

CONFIG, LOSSES, CURVE, CHECKPOINT, KEPT, POLICIES, SPEED, REPLAY_FOLDER = (
    "config.json",
    "losses.csv",
    "curve.csv",
    "checkpoint.safetensors",
    "checkpoints",
    "policies",
    "speed.csv",
    "replay",
)

ZOO = "zoo:"
"""Before the name of a run of the package."""

CURVE_METRICS = ("return", "success", "clean_success")
"""Columns of a learning curve, as means over the episodes of each evaluation."""


def run_folders(folder: Path) -> tuple[Path, ...]:
    """Returns the folder itself if it is a run, else the runs inside it, ordered by their seeds."""
    inside = sorted(folder.glob(f"seeds-*/{CONFIG}"), key=_by_seeds)
    files = [folder / CONFIG] if (folder / CONFIG).exists() else inside
    return tuple(file.parent for file in files)


def run_names(runs: Sequence[Path]) -> list[str]:
    """Names of runs: those of their folders, or their paths if two folders have the same name."""
    names = [run.resolve().name for run in runs]
    return names if len(set(names)) == len(names) else [str(run) for run in runs]


def group_folder(out: Path, seeds: Sequence[int]) -> Path:
    """Where one of several processes trains its share of the seeds of a run."""
    return out / f"seeds-{'-'.join(map(str, seeds))}"


def find_run(name: str | Path) -> Path | None:
    """Finds a training run by its folder, or as `zoo:ALGORITHM/DATASET`; None: that is no run."""
    if str(name).startswith(ZOO):
        if (wanted := str(name).removeprefix(ZOO)) not in zoo():
            hint = "Train others with `swarmdata train ALGORITHM DATASET`."
            raise UnknownNameError("run of the zoo", wanted, zoo(), hint)
        algorithm, _, dataset = wanted.partition("/")
        return _zoo_folder() / dataset / algorithm
    return Path(name) if is_folder(name) and run_folders(Path(name)) else None


def zoo() -> tuple[str, ...]:
    """Names of the package's runs, such as `iql/coop_nav-medium-replay`."""
    runs = (file.parent for file in _zoo_folder().glob(f"*/*/{CONFIG}"))
    return tuple(sorted(f"{run.name}/{run.parent.name}" for run in runs))


def _zoo_folder() -> Path:
    return Path(str(files("swarmdata.cards"))) / "zoo"


class Seed(NamedTuple):
    """One seed of one run."""

    folder: Path
    seed: int


def seeds_of(runs: Sequence[Path]) -> list[Seed]:
    """All seeds of run folders, or of the runs in a folder that several processes trained."""
    found = []
    for run in runs:
        folders = run_folders(run)
        if not folders:
            raise BuildError(f"{run} holds no run: there is no {CONFIG} in it")
        for folder in folders:
            found += [Seed(folder, int(seed)) for seed in read_document(folder / CONFIG)["seeds"]]
    return found


def _by_seeds(config: Path) -> tuple[int, ...]:
    return tuple(int(seed) for seed in config.parent.name.split("-")[1:] if seed.isdecimal())


def is_online(folder: Path) -> bool:
    """Whether a run folder is of online training; `vdn` and `qmix` exist offline and online."""
    config = folder / CONFIG
    return config.exists() and "dataset" not in read_document(config)


def read_table(path: Path) -> list[dict[str, float]]:
    """Reads the rows of `losses.csv` and the like; values that were not measured are absent."""
    with path.open(newline="", encoding="utf-8") as file:
        return [{k: float(v) for k, v in row.items() if v} for row in csv.DictReader(file)]


def policy_path(folder: Path, seed: int, frames: int) -> Path:
    """Where an online run keeps the policy of a seed at a checkpoint."""
    return folder / POLICIES / f"seed-{seed}" / f"{frames:010d}.safetensors"


def saved_policies(folder: Path, seed: int) -> list[Path]:
    """The policies that an online run has saved of a seed, in the order of training."""
    return sorted((folder / POLICIES / f"seed-{seed}").glob("*.safetensors"))


def saved_frames(folder: Path, seed: int) -> list[int]:
    """Frames at which a run kept policies of a seed, in order."""
    return [int(file.stem) for file in saved_policies(folder, seed)]


def last_policy_path(folder: Path, seed: int) -> Path:
    """The newest policy of a seed; BuildError if the run has not reached a checkpoint yet."""
    found = saved_policies(folder, seed)
    if not found:
        raise BuildError(
            f"{folder} has no policy of seed {seed} yet; wait for its first checkpoint"
        )
    return found[-1]


def measured_files(folder: Path, seed: int) -> tuple[Path, ...]:
    """The files that decide what a seed's policy does; of an online run, its newest policy."""
    config = folder / CONFIG
    if not is_online(folder):
        return config, folder / CHECKPOINT
    return config, *saved_policies(folder, seed)[-1:]


def run_hash(folder: Path, seed: int) -> str:
    """SHA-256 over the names and contents of the measured files; a missing file counts as empty.

    It changes with the configuration, the dataset's digest, and every update of the training.
    """
    total = hashlib.sha256()
    for file in measured_files(folder, seed):
        total.update(f"{file.relative_to(folder).as_posix()}\n".encode())
        content = file.read_bytes() if file.exists() else b""
        total.update(hashlib.sha256(content).digest())
    return total.hexdigest()
