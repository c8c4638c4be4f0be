"""MADDPG: actors that see what their robots see, led by a critic that sees everything.

Lowe et al., "Multi-agent actor-critic for mixed cooperative-competitive environments", NeurIPS
2017, equations 5 and 6; with the corrections of TD3 (Fujimoto et al. 2018, algorithm 1) it is MATD3
(Ackermann et al. 2019, section 4). With the reward r_i of robot i, Q_ji what critic j says of it,
and what the critics see, x = (state, all observations):

    y_i    = r_i + gamma (1 - termination) min_j Q'_ji(x', pi'(o') + clip(noise, -c, c))
    L(Q_j) = 1/N sum_i Huber(Q_ji(x, a) - y_i)                       every gradient step
    L(pi)  = -1/N sum_i Q_1i(x, pi(o)) + w |logits of pi(o)|^2       every `policy_delay`-th

`corrections` "none" is the original: one critic, no smoothing noise, no delay.

Deviations:
- A critic is one network with a value for each robot's reward, where the paper has a network for
  each. The robots are a team: all climb the mean of the values, which is the value of the team's
  reward.
- `joint_gradient` "all": Q sees every robot's action from its policy (the centralized gradient of
  FACMAC, Peng et al. 2021, equation 7). "own" is the paper's equation 5: robot i's action from its
  policy, the others' from the replay.
- `parameters` "shared": one actor for all robots, which sees the robot's number; the paper's robots
  have one each ("separate").
- The critics have LayerNorm; Huber loss instead of squares; inputs are normalized by what random
  actions lead to; actions and observations are turned to the robot's target (`frame`).
- w is the weight that the paper's code puts on the actor's outputs before they are squashed.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from swarmdata.interfaces import VecEnv
from swarmdata.learn.networks.optimizer import linear
from swarmdata.learn.policies.torch_policy import TorchPolicy
from swarmdata.learn.training.checkpoint import part
from swarmdata.learn.training.exploration import LinearSchedule, gaussian, uniform_like
from swarmdata.online_algos.collection.maddpg_learner import Learner, MADDPGConfig
from swarmdata.online_algos.collection.replay_collection import Collector, Plan
from swarmdata.types import Batch


class MADDPG:
    """K seeds of MADDPG in worlds of their own.

    Args:
        env: K E copies of a task.
        seeds: of everything random, [K].
        config: settings.
        folder: of the replay.
    """

    Config = MADDPGConfig
    LOSSES = (*Learner.LOSSES, "reward")

    def __init__(
        self, env: VecEnv, seeds: Sequence[int], config: MADDPGConfig, folder: Path | str
    ) -> None:
        self.config = config
        self.collector = Collector(env, seeds, Plan.of(config), folder)
        self.learner = Learner(self.collector.sizes, seeds, config)
        self.schedule = LinearSchedule(config.noise, config.final_noise, config.exploration)

    @property
    def frames(self) -> int:
        """Joint steps that each seed has taken."""
        return self.collector.frames

    def update(self) -> dict[str, Tensor]:
        """One round of acting and learning; returns losses, each [K], NaN before learning began."""
        return self.collector.round(self._act, self._learn, Learner.LOSSES)

    def policy(self, index: int) -> TorchPolicy:
        """The greedy policy of seed number `index`, as it is now."""
        mean, std = self.collector.inputs_of(index)
        return TorchPolicy(
            layers=self.learner.actors.extract(index),
            observation_mean=mean,
            observation_std=std,
            squash=True,
            frame=self.collector.frame,
            parameters=self.config.parameters,
        )

    def warm_start(self) -> bool:
        """Does nothing: the first rounds fill the replay."""
        return False

    def restart_worlds(self) -> None:
        """Begins new episodes everywhere, as loading a state does."""
        self.collector.worlds.restart()

    def state_dict(self) -> dict[str, Tensor]:
        """Everything but the running episodes and the rows of the replay, as copies."""
        learner = {f"learner.{k}": v for k, v in self.learner.state_dict().items()}
        return learner | {f"collector.{k}": v for k, v in self.collector.state_dict().items()}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Restores what `state_dict` returned; the folder must be that of the same run.

        Raises:
            CheckpointError: the replay in the folder does not belong to the state.
        """
        self.collector.load_state_dict(part(state, "collector"))
        self.learner.load_state_dict(part(state, "learner"))

    @torch.no_grad()
    def _act(self, observations: Tensor) -> tuple[Tensor, Tensor]:
        actions = self.learner.actions(observations)
        if self.frames < self.config.warm_up:
            actions = 2 * uniform_like(self.collector.acting, actions) - 1
        else:
            deviation = self.schedule.at(self.collector.progress)
            actions = gaussian(self.collector.acting, actions, deviation)
        return actions, actions

    def _learn(self, batch: Batch) -> dict[str, Tensor]:
        return self.learner.update(
            batch, linear(self.collector.progress, self.config.final_step_size)
        )
