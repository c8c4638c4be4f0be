"""Trained actors from the package's checkpoints, checked by digest and evaluated exactly."""

import hashlib
from importlib.resources import files
from pathlib import Path

import numpy as np

from swarmdata.behavior_policies.actor import Actor, Saved, forward, load_actor, save_actor
from swarmdata.behavior_policies.noise import add_noise, check_noise
from swarmdata.density import LastMeans, noisy_log_probs
from swarmdata.errors import CheckpointError
from swarmdata.spec import TaskSpec
from swarmdata.types import Float, Int, Step

__all__ = [
    "Actor",
    "Learned",
    "Saved",
    "digest_of",
    "forward",
    "load_actor",
    "own_actor",
    "read_checkpoint",
    "save_actor",
]


class Learned:
    """A trained actor from a checkpoint file, with optional Gaussian action noise.

    Args:
        spec: the task; its number of robots must be what the actor was trained for if the actor
            takes a one-hot robot index.
        checkpoint: a file name in the package's `behavior_policies/checkpoints`, or an absolute
            path.
        sha256: of that file, hex.
        noise: standard deviation of the Gaussian noise on each action component.

    Raises:
        CheckpointError: no such file, another digest, or not an actor that can be run exactly.
        SpecError: `noise` is not a standard deviation.
    """

    uses_state = False

    def __init__(self, spec: TaskSpec, *, checkpoint: str, sha256: str, noise: float = 0.0) -> None:
        self._actor = load_actor(read_checkpoint(checkpoint, sha256), spec.n_agents, checkpoint)
        self._noise = check_noise(noise)
        self._last = LastMeans()

    def reset(self, step: Step, copies: Int) -> None:
        """Does nothing: the policy remembers nothing."""

    def act(self, step: Step) -> Float:
        means = self._last.keep(step, forward(self._actor, step.observations))
        return add_noise(means, step, self._noise).astype(np.float32)

    def log_probs(self, step: Step, actions: Float) -> Float:
        means = self._last.recall(step)  # right after `act`: the network need not run again
        if means is None:
            means = forward(self._actor, step.observations)
        return noisy_log_probs(means, actions, self._noise)


def own_actor(path: Path, spec: TaskSpec) -> Learned:
    """The actor in a file that `save_actor` wrote, whatever its digest."""
    return Learned(spec, checkpoint=str(path.resolve()), sha256=digest_of(path))


def digest_of(path: Path) -> str:
    """SHA-256 of a file, hex."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def read_checkpoint(checkpoint: str, sha256: str) -> bytes:
    """Returns the bytes of a checkpoint file.

    Args:
        checkpoint: a file name in the package's checkpoints, or an absolute path.
        sha256: the expected digest, hex.

    Raises:
        CheckpointError: the file is absent or has another digest.
    """
    path = Path(checkpoint)
    if not path.is_absolute():
        if path.name != checkpoint:
            raise CheckpointError(
                f"checkpoint {checkpoint!r} is neither a file name nor an absolute path."
            )
        path = Path(str(files("swarmdata.behavior_policies") / "checkpoints" / checkpoint))
    try:
        data = path.read_bytes()
    except OSError as error:
        raise CheckpointError(f"cannot read checkpoint {path}: {error}") from error
    digest = hashlib.sha256(data).hexdigest()
    if digest != sha256.lower():
        raise CheckpointError(
            f"checkpoint {path} has SHA-256 {digest}, expected {sha256}. "
            "Restore the file that the recipe names, or update the recipe."
        )
    return data
