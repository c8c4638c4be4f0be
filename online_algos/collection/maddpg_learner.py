"""What MADDPG learns from batches: actors, critics and their targets; the maths is in `maddpg`."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import torch
from torch import Tensor
from torch.nn.functional import smooth_l1_loss

from swarmdata.learn.networks.actor import ACTOR_STREAM
from swarmdata.learn.networks.critics import JointCritics, JointGradient
from swarmdata.learn.networks.network_inputs import (
    generator_states,
    generators,
    information,
    restore_generators,
)
from swarmdata.learn.networks.optimizer import StackedAdam
from swarmdata.learn.networks.perceptrons import MLPShape, StackedMLP
from swarmdata.learn.networks.sizes import Sizes
from swarmdata.learn.networks.team_networks import Parameters, Team
from swarmdata.learn.objectives.td_targets import move_target, td_target
from swarmdata.learn.training.checkpoint import part
from swarmdata.learn.training.exploration import normal_like
from swarmdata.types import Batch

NOISE_STREAM = 2
"""Stream of a seed's smoothing noise; the networks have the streams before it."""


@dataclass(frozen=True)
class MADDPGConfig:
    """Settings of MADDPG; counts of frames are joint steps of one seed."""

    n_frames: int = 2_000_000
    n_copies: int = 64
    n_steps: int = 64  # of every copy in one round
    n_gradient_steps: int = 2  # after each of them
    batch_size: int = 256  # joint transitions
    capacity: int = (
        262_144  # transitions that are drawn from; with margin 1.1 GB of disk on coop_nav
    )
    margin: int = 262_144  # most frames between two checkpoints of a run that can be resumed
    warm_up: int = 8_192  # frames before the first gradient step, with random actions
    corrections: Literal["td3", "none"] = "td3"
    joint_gradient: JointGradient = "all"
    actor_hidden: tuple[int, ...] = (64, 64)
    critic_hidden: tuple[int, ...] = (128, 128)
    parameters: Parameters = "shared"
    frame: str = "target"  # in which robots see and act, `frames.find_frame`
    step_size: float = 1e-3
    critic_step_size: float = 1e-3
    final_step_size: float = 0.05  # factor at the end of training, reached linearly
    discount: float = 0.97
    reward_scale: float = 1.0
    polyak: float = 0.03  # per step of the actors; 0.01 follows in 200 gradient steps
    policy_delay: int = 2  # Fujimoto et al. 2018, section 6.1
    smoothing: float = 0.1  # half of the paper's; not compared alone
    smoothing_clip: float = 0.5
    logit_penalty: float = 1e-3  # w, from the code of Lowe et al.
    noise: float = 0.5  # deviation of exploring actions
    final_noise: float = 0.1
    exploration: float = 0.5  # part of training in which the noise falls
    max_gradient_norm: float | None = 10.0  # per seed, of each network kind

    @property
    def n_critics(self) -> int:
        """Critics of one seed, J."""
        return 2 if self.corrections == "td3" else 1

    @property
    def delay(self) -> int:
        """Steps of the critics for one of the actors."""
        return self.policy_delay if self.corrections == "td3" else 1


class Learner:
    """K seeds of actors and critics, trained on batches of normalized observations and states.

    Args:
        sizes: numbers of robots and features.
        seeds: of initial parameters and noise, [K].
        config: settings.
    """

    LOSSES = ("critic_loss", "q", "policy_q")

    def __init__(self, sizes: Sizes, seeds: Sequence[int], config: MADDPGConfig) -> None:
        self.config, self.sizes, self.n_updates = config, sizes, 0
        shape = MLPShape(sizes.observation, config.actor_hidden, sizes.action)
        self.actors = Team(
            shape, sizes.n_agents, seeds, ACTOR_STREAM, parameters=config.parameters, device="cpu"
        )
        self.critics = JointCritics(
            sizes, seeds, config.critic_hidden,
            learning_rate=config.critic_step_size, max_norm=config.max_gradient_norm,
            n_critics=config.n_critics, n_values=sizes.n_agents,
        )  # fmt: skip
        self.target_actors = self.actors.network.clone()
        self.actor_optimizer = StackedAdam(
            self.actors.network, len(seeds), config.step_size, config.max_gradient_norm
        )
        self.generators = generators(seeds, "cpu", NOISE_STREAM)

    def actions(self, observations: Tensor, network: StackedMLP | None = None) -> Tensor:
        """Returns actions, [K, B, N, A], of normalized observations [K, B, N, O]."""
        return self.actors(observations, network).tanh()

    def update(self, batch: Batch, scale: float = 1.0) -> dict[str, Tensor]:
        """One step on tensors [K, B, ...]; returns losses [K], the actors' only when they move.

        Args:
            batch: normalized observations and states.
            scale: factor on the step sizes.
        """
        x = information(batch.states, batch.observations)
        losses = self._update_critics(batch, x, scale)
        self.n_updates += 1
        if self.n_updates % self.config.delay == 0:
            losses |= self._update_actors(batch, x, scale)
            move_target(self.target_actors, self.actors.network, self.config.polyak)
            self.critics.follow(self.config.polyak)
        return {name: loss.detach() for name, loss in losses.items()}

    @torch.no_grad()
    def targets(self, batch: Batch) -> Tensor:
        """Returns y, [K, B, N], in units of scaled rewards; draws the smoothing noise, if any."""
        config = self.config
        a_next = self.actions(batch.next_observations, self.target_actors)
        if config.corrections == "td3":
            noise = config.smoothing * normal_like(self.generators, a_next)
            a_next = a_next + noise.clamp(-config.smoothing_clip, config.smoothing_clip)
        x_next = information(batch.next_states, batch.next_observations)
        q_next = self.critics.target_q(x_next, a_next.clamp(-1, 1)).amin(1)  # [K, B, N]
        r = batch.rewards * config.reward_scale
        return td_target(r, batch.terminations[..., None], q_next, config.discount)

    def _update_critics(self, batch: Batch, x: Tensor, scale: float) -> dict[str, Tensor]:
        y = self.targets(batch)  # [K, B, N]
        q = self.critics.q(x, batch.actions)  # [K, J, B, N]
        errors = smooth_l1_loss(q, y[:, None].expand_as(q), reduction="none")
        loss = errors.mean((2, 3)).sum(1)  # [K]
        self.critics.step(loss, scale)
        return {"critic_loss": loss, "q": q.mean((1, 2, 3))}

    def _update_actors(self, batch: Batch, x: Tensor, scale: float) -> dict[str, Tensor]:
        logits = self.actors(batch.observations)
        # [K, B, N], or [K, B N, N] for "own"; the critics' parameters are constants here
        values = self.critics.policy_values(
            x, logits.tanh(), batch.actions, self.config.joint_gradient
        )
        q = values.mean(-1).mean(1)  # [K]
        size = logits.square().mean((1, 2, 3))
        self.actor_optimizer.step(self.config.logit_penalty * size - q, scale)
        return {"policy_q": q}

    def state_dict(self) -> dict[str, Tensor]:
        """Parameters, targets, Adam's moments, generators and number of updates, as copies."""
        return {
            "n_updates": torch.tensor(self.n_updates),
            "generators": generator_states(self.generators),
            "actors": self.actors.network.flat.clone(),
            "target_actors": self.target_actors.flat.clone(),
            **{f"actor_adam.{k}": v for k, v in self.actor_optimizer.state_dict().items()},
            **self.critics.state_dict(),
        }

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Restores what `state_dict` returned."""
        self.n_updates = int(state["n_updates"])
        restore_generators(self.generators, state["generators"])
        self.actors.network.load(state["actors"])
        self.target_actors.load(state["target_actors"])
        self.actor_optimizer.load_state_dict(part(state, "actor_adam"))
        self.critics.load_state_dict(state)
