"""NetworkPolicy, a behavior policy from a policy's file that cannot be run exactly."""

from pathlib import Path

import numpy as np

from swarmdata.behavior_policies.checkpoint_files import read_checkpoint
from swarmdata.behavior_policies.exact_actor import round_to_grid
from swarmdata.behavior_policies.noise import add_noise, check_noise
from swarmdata.learn.policies.policy_file import parse_policy
from swarmdata.rollouts.action_probabilities import LastMeans, noisy_log_probs
from swarmdata.specs.origins import SideSpec
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Double, Float, Int, Step


class NetworkPolicy:
    """A trained policy of any kind, with optional Gaussian action noise.

    `behavior_policies.learned` runs perceptrons with the same bits everywhere. Memories, sets and
    flows have sums that are rounded, and their last bits differ from machine to machine. Here
    actions are rounded to multiples of 2^-12: a dataset is usually the same on another machine,
    and this is no promise.

    `log_probs` are those of the noise about the policy's action; of a policy that draws (flows,
    latents), given its draw.

    Args:
        checkpoint: name of a file in the dataset's `checkpoints`, or the path of any other file
            that `policy_file.save_policy` wrote.
        sha256: of that file, hex.
        noise: standard deviation of the Gaussian noise on each action component.
        folder: of the dataset whose recipe names the checkpoint, if there is one.

    Raises:
        CheckpointError: no such file, another digest, or no policy.
        SpecError: `noise` is not a standard deviation.
    """

    def __init__(
        self,
        spec: TaskSpec | SideSpec,
        *,
        checkpoint: str | Path,
        sha256: str,
        noise: float = 0.0,
        folder: Path | None = None,
    ) -> None:
        self._policy = parse_policy(read_checkpoint(checkpoint, sha256, folder), str(checkpoint))
        self.uses_state = self._policy.uses_state
        self._noise = check_noise(noise)
        self._last = LastMeans[Double]()

    def reset(self, step: Step, copies: Int) -> None:
        self._policy.reset(step, copies)

    def act(self, step: Step) -> Float:
        actions = self._policy.act(step).astype(np.float64)
        means = self._last.keep(step, round_to_grid(actions, 1.0) + 0.0)
        return add_noise(means, step, self._noise).astype(np.float32)

    def log_probs(self, step: Step, actions: Float) -> Float:
        return noisy_log_probs(self._last.require(step), actions, self._noise)
