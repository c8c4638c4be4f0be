"""Trained actors from the package's checkpoints, checked by digest and evaluated exactly."""

from pathlib import Path

import numpy as np

from swarmdata.behavior_policies.checkpoint_files import digest_of, read_checkpoint
from swarmdata.behavior_policies.exact_actor import forward, load_actor
from swarmdata.behavior_policies.noise import add_noise, check_noise
from swarmdata.rollouts.action_probabilities import LastMeans, noisy_log_probs
from swarmdata.specs.origins import SideSpec
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Double, Float, Int, Step


class Learned:
    """A trained actor from a checkpoint file, with optional Gaussian action noise.

    Args:
        spec: the task, or the side that the actor plays; with as many robots as the actor was
            trained for if it takes their index.
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
        spec: TaskSpec | SideSpec,
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


def own_actor(path: Path, spec: TaskSpec | SideSpec) -> Learned:
    """Returns the actor in a file that `save_actor` wrote, without a check of its digest."""
    return Learned(spec, checkpoint=path, sha256=digest_of(path))
