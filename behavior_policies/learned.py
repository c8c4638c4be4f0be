"""Trained actors from the package's checkpoints, checked by digest and evaluated exactly."""

import hashlib
from collections.abc import Iterable
from importlib.resources import files
from pathlib import Path

import numpy as np

from swarmdata.behavior_policies.exact_actor import Actor, Saved, forward, load_actor, save_actor
from swarmdata.behavior_policies.noise import add_noise, check_noise
from swarmdata.errors import CheckpointError
from swarmdata.rollouts.action_probabilities import LastMeans, noisy_log_probs
from swarmdata.runtime.regular_files import read_regular
from swarmdata.specs.plain_names import checked_file_name
from swarmdata.specs.recipe import PolicySource
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.store.arrays.layout import CHECKPOINTS
from swarmdata.types import Double, Float, Int, Step

__all__ = [
    "Actor",
    "Learned",
    "Saved",
    "digest_of",
    "forward",
    "load_actor",
    "own_actor",
    "own_checkpoints",
    "read_checkpoint",
    "save_actor",
]


MAX_CHECKPOINT_BYTES = 1 << 24
"""Largest checkpoint file that is read; the shipped ones have about 2**16 bytes."""


class Learned:
    """A trained actor from a checkpoint file, with optional Gaussian action noise.

    Args:
        spec: the task; its number of robots must be what the actor was trained for if the actor
            takes a one-hot robot index.
        checkpoint: name of a file in the package's `behavior_policies/checkpoints` or in those of
            the dataset, or the path of any other checkpoint.
        sha256: of that file, hex.
        noise: standard deviation of the Gaussian noise on each action component.
        folder: of the dataset whose recipe names the checkpoint, if there is one.

    Raises:
        CheckpointError: no such file, another digest, or not an actor that can be run exactly.
        SpecError: `noise` is not a standard deviation.
    """

    uses_state = False

    def __init__(
        self,
        spec: TaskSpec,
        *,
        checkpoint: str | Path,
        sha256: str,
        noise: float = 0.0,
        folder: Path | None = None,
    ) -> None:
        data = read_checkpoint(checkpoint, sha256, folder)
        self._actor = load_actor(data, spec.n_agents, str(checkpoint))
        self._noise = check_noise(noise)
        self._last = LastMeans[Double]()

    def reset(self, step: Step, copies: Int) -> None:
        """Does nothing: the policy has no memory."""

    def act(self, step: Step) -> Float:
        means = self._last.keep(step, forward(self._actor, step.observations))
        return add_noise(means, step, self._noise).astype(np.float32)

    def log_probs(self, step: Step, actions: Float) -> Float:
        means = self._last.recall(step)  # right after `act`, the network need not run again
        if means is None:
            means = forward(self._actor, step.observations)
        return noisy_log_probs(means, actions, self._noise)


def own_actor(path: Path, spec: TaskSpec) -> Learned:
    """Returns the actor in a file that `save_actor` wrote, without a check of its digest."""
    return Learned(spec, checkpoint=path, sha256=digest_of(path))


def digest_of(path: Path) -> str:
    """Returns the SHA-256 of a checkpoint file, hex.

    Raises:
        CheckpointError: it cannot be read, is not a regular file, or is too large.
    """
    return hashlib.sha256(_content(path)).hexdigest()


def read_checkpoint(checkpoint: str | Path, sha256: str, folder: Path | None = None) -> bytes:
    """Returns the bytes of a checkpoint file.

    Args:
        checkpoint: a file's name, as in recipes, which is looked up in the package's checkpoints
            and then in those of `folder`; or the path of any other checkpoint. Recipes contain
            names only, never paths.
        sha256: the expected digest, hex.
        folder: of the dataset whose recipe names the checkpoint, if there is one.

    Raises:
        CheckpointError: the file is absent, is not a regular file, is too large, or has another
            digest.
    """
    path = checkpoint if isinstance(checkpoint, Path) else _find(checkpoint, folder)
    data = _content(path, follow_links=folder is None or path.parent != folder / CHECKPOINTS)
    digest = hashlib.sha256(data).hexdigest()
    if digest != sha256.lower():
        raise CheckpointError(
            f"checkpoint {path} has SHA-256 {digest}, expected {sha256}. "
            "Restore the file that the recipe names, or update the recipe."
        )
    return data


def own_checkpoints(policies: Iterable[PolicySource], folder: Path | None) -> dict[str, bytes]:
    """Returns the checkpoints that recipes name and the package does not have, by file name.

    Args:
        policies: of a recipe.
        folder: with a folder `checkpoints`; None: there is none.

    Raises:
        CheckpointError: one is absent, or is not the one that its recipe means.
    """
    found = {}
    for source in policies:
        name, sha256 = source.checkpoint, source.sha256
        if name is None or sha256 is None or _shipped(name).exists():
            continue
        if folder is None or not (folder / CHECKPOINTS / name).exists():
            raise CheckpointError(
                f"the recipe's policy {source.label!r} needs the checkpoint {name}, which is not "
                f"in the package{'' if folder is None else f' or in {folder / CHECKPOINTS}'}. "
                "It is in the folder of every dataset of the recipe: build from the recipe.json "
                "there, or copy its folder checkpoints beside the recipe."
            )
        found[name] = read_checkpoint(name, sha256, folder)
    return found


def _find(name: str, folder: Path | None) -> Path:
    """Returns the path of a named checkpoint, in the package or in a dataset's folder."""
    try:
        checked_file_name(name)
    except ValueError as error:
        raise CheckpointError(
            f"checkpoint {error}. Checkpoints are in the folder {CHECKPOINTS!r} of the "
            "package, or of the dataset."
        ) from error
    shipped = _shipped(name)
    if shipped.exists() or folder is None:
        return shipped
    if (folder / CHECKPOINTS).is_symlink():
        raise CheckpointError(f"{folder / CHECKPOINTS} is a symbolic link, expected a folder")
    return folder / CHECKPOINTS / name


def _shipped(name: str) -> Path:
    """The path that a checkpoint of the package has."""
    return Path(str(files("swarmdata.behavior_policies"))) / CHECKPOINTS / name


def _content(path: Path, *, follow_links: bool = True) -> bytes:
    try:
        return read_regular(path, MAX_CHECKPOINT_BYTES, follow_links=follow_links)
    except OSError as error:
        raise CheckpointError(f"cannot read checkpoint {path}: {error}") from error
