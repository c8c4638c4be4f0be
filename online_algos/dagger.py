"""DAgger: clones a teacher that is asked what to do in the states that the team itself gets into.

Ross, Gordon and Bagnell, "A reduction of imitation learning and structured prediction to no-regret
online learning", AISTATS 2011, algorithm 3.1. A clone of recorded episodes meets states that the
teacher never met, where it errs more and more; here these states get labels, too. With a teacher
t(s), policies pi(o), states s that the team met in a round, and data D of all rounds:

    (1) D  <- D + {(o, t(s))}                 the teacher acts in the first round (beta_1 = 1),
                                              the policies in all others (beta_i = 0)
    (2) pi <- argmin mean |pi(o) - t(s)|^2    over D

The teacher sees the state, where the policies see observations. The policies of early rounds lie
between no skill and the teacher, also in tasks whose rewards teach little.

Deviations:
- (2) goes on with the networks of the round before, for `n_passes` over the data;
- actions are taken with noise, so that the team meets states that need corrections;
- the last policies are kept, not those of the best round.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from swarmdata.errors import SpecError
from swarmdata.learn.networks.network_inputs import generators as torch_generators
from swarmdata.learn.networks.optimizer import Descent, linear
from swarmdata.learn.networks.team_networks import Parameters
from swarmdata.learn.policies.recurrent_policy import RecurrentPolicy
from swarmdata.learn.policies.torch_policy import TorchPolicy
from swarmdata.learn.training.checkpoint import part
from swarmdata.online_algos.actors.mean_actors import Actors, collection_state, restore_collection
from swarmdata.online_algos.collection.input_moments import N_MEASURED, measure_moments
from swarmdata.online_algos.collection.training_worlds import Worlds
from swarmdata.online_algos.continuation.offline_start import OfflineStart, actor_settings
from swarmdata.online_algos.imitation.labelled_states import StoredStates
from swarmdata.online_algos.imitation.teacher_cloning import collect, regress
from swarmdata.online_algos.imitation.teachers import TeacherSettings, teacher_of
from swarmdata.perception.frames import find_frame
from swarmdata.rollouts.side_env import AnyEnv


@dataclass(frozen=True)
class DAggerConfig(TeacherSettings):
    """Hyperparameters; steps are joint steps of one seed's worlds."""

    teacher: str = "scripted"
    n_steps: int = 524_288
    n_copies: int = 64  # for each seed
    rollout_steps: int = 256  # of each copy in a round
    hidden: int = 128  # units of both layers
    parameters: Parameters = "shared"
    frame: str = "target"  # see frames.find_frame
    learning_rate: float = 1e-3
    final_learning_rate_factor: float = 0.05  # at the end of training, reached linearly
    n_passes: int = 2  # over all data so far, per round
    max_samples: int = 1_500_000  # robot samples that the passes of a round may take together
    minibatch: int = 2048  # robot samples
    noise: float = 0.05  # standard deviation of the noise on actions

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.teacher:
            raise SpecError("teacher is empty, expected a policy to clone, such as 'scripted'")


class DAgger:
    """K training runs, one a seed, in K E copies of a task: rounds of collection and regression.

    The folder gets the labelled states.

    Raises:
        CheckpointError: the folder has the labelled states of another run.
        SpecError: the teacher does not fit the task, or the task has no such frame.
        UnknownNameError: there is no such teacher.
    """

    Config = DAggerConfig
    LOSSES = ("error", "std")

    settings_of = staticmethod(actor_settings)

    def __init__(
        self, env: AnyEnv, seeds: Sequence[int], config: DAggerConfig, folder: Path | str
    ) -> None:
        self.config, self.seeds, self.frames = config, tuple(seeds), 0
        self.worlds = Worlds(env, seeds, find_frame(env.features, config.frame, env.spec.robots))
        self.teacher = teacher_of(config, env)
        self.generators = [np.random.default_rng(seed) for seed in seeds]
        moments = measure_moments(self.worlds, torch_generators(seeds, "cpu"), N_MEASURED)
        sizes = self.worlds.sizes
        self.actors = Actors(sizes, seeds, config.hidden, config.parameters, moments)
        self.descent = Descent({"actor": self.actors.network}, len(seeds), 1.0, None)
        n_rounds = -(-config.n_steps // (config.rollout_steps * config.n_copies))
        by_network = sizes.n_agents // self.actors.n_rows  # robots whose samples a network gets
        self.states = StoredStates(
            Path(folder), len(seeds) * self.actors.n_rows, n_rounds,
            config.rollout_steps * config.n_copies * by_network,
            (self.actors.network.shape.inputs, sizes.action),
        )  # fmt: skip
        self._show_episodes()

    @property
    def progress(self) -> float:
        return min(1.0, self.frames / self.config.n_steps)

    def prepare(self) -> bool:
        """Does nothing: the teacher acts in the first round."""
        return False

    def start_from(self, start: OfflineStart) -> list[str]:
        self.actors.start_from(start, self.seeds, self.worlds.frame)
        return []

    def update(self) -> dict[str, Tensor]:
        """One round; returns the mean squared error of actions and the noise, each [K]."""
        c = self.config
        new = collect(
            self.actors, self.worlds, self.generators, self.teacher, c.rollout_steps, c.noise,
            teacher_acts=not self.frames,
        )  # fmt: skip
        self.states.append(new)  # (1)
        error = regress(
            self.actors, self.descent, self.generators, self.states,
            min(c.n_passes * len(self.states), c.max_samples), c.minibatch,
            c.learning_rate * linear(self.progress, c.final_learning_rate_factor),
        )  # (2)  # fmt: skip
        self.frames += c.rollout_steps * c.n_copies
        return {"error": error, "std": torch.full((len(self.seeds),), c.noise)}

    def policy(self, index: int) -> TorchPolicy | RecurrentPolicy:
        return self.actors.policy(index, self.worlds.frame)

    def restart_worlds(self) -> None:
        self.worlds.restart()
        self._show_episodes()

    def _show_episodes(self) -> None:
        """Tells the teacher that all copies have begun new episodes."""
        self.teacher.reset(self.worlds.current_step, np.arange(self.worlds.env.n_copies))

    def state_dict(self) -> dict[str, Tensor]:
        """Everything but the running episodes and the labelled states, which are on disk then."""
        return {
            **self.descent.state_dict(),
            **collection_state(self),
            **{f"states.{k}": v for k, v in self.states.state_dict().items()},
        }

    def load_state_dict(self, state: Mapping[str, Tensor]) -> None:
        self.states.load_state_dict(part(state, "states"))
        self.descent.load_state_dict(state)
        restore_collection(self, state)
        self._show_episodes()
