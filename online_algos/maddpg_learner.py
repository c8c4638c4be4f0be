"""What MADDPG learns from batches: actors, critics and their targets; the maths is in `maddpg`."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import torch
from torch import Tensor
from torch.nn.functional import smooth_l1_loss

from swarmdata.learn.checkpoint import part
from swarmdata.learn.exploration import normal_like
from swarmdata.learn.inputs import generator_states, generators, restore_generators
from swarmdata.learn.networks import MLPShape, StackedMLP, initialize
from swarmdata.learn.optimizer import StackedAdam
from swarmdata.learn.sizes import Sizes
from swarmdata.learn.targets import polyak, td_target
from swarmdata.learn.team import Parameters, Team
from swarmdata.types import Batch

ACTOR_STREAM, CRITIC_STREAM, NOISE_STREAM = 0, 1, 2
"""Streams of a seed's initial parameters and of its smoothing noise."""


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
    joint_gradient: Literal["all", "own"] = "all"
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
        inputs = sizes.state + sizes.n_agents * (sizes.observation + sizes.action)
        shape = MLPShape(inputs, config.critic_hidden, sizes.n_agents, layer_norm=True)
        # rows: seed 0 critic 0, seed 0 critic 1, seed 1 critic 0, ...
        self.critics = StackedMLP(shape, config.n_critics * len(seeds), "cpu")
        initialize(self.critics, seeds, CRITIC_STREAM)
        self.target_actors = self.actors.network.clone()
        self.target_critics = self.critics.clone()
        norm, k = config.max_gradient_norm, len(seeds)
        self.actor_optimizer = StackedAdam(self.actors.network, k, config.step_size, norm)
        self.critic_optimizer = StackedAdam(self.critics, k, config.critic_step_size, norm)
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
            polyak(self.target_actors, self.actors.network, self.config.polyak)
            polyak(self.target_critics, self.critics, self.config.polyak)
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
        q_next = self.q(self.target_critics, x_next, a_next.clamp(-1, 1)).amin(1)  # [K, B, N]
        r = batch.rewards * config.reward_scale
        return td_target(r, batch.terminations[..., None], q_next, config.discount)

    def q(self, critics: StackedMLP, x: Tensor, actions: Tensor) -> Tensor:
        """Returns all critics' values of every robot's reward, [K, J, B, N].

        Args:
            critics: the critics or their targets.
            x: what the critics see, [K, B, S + N O].
            actions: joint actions, [K, B, N, A].
        """
        n_critics = self.config.n_critics
        inputs = torch.cat([x, actions.flatten(2)], 2)
        values = critics(inputs.repeat_interleave(n_critics, 0))
        return values.view(-1, n_critics, *values.shape[1:])

    def policy_values(self, x: Tensor, pi: Tensor, actions: Tensor) -> Tensor:
        """Returns Q_1 of the policies' actions, the mean over robots, [K, B].

        For `joint_gradient` "own" there is one value for each robot that leaves the data, [K, B N].

        The critics' parameters are constants here: the actors' loss must not move them.

        Args:
            x: what the critics see, [K, B, S + N O].
            pi: actions of the policies, [K, B, N, A].
            actions: of the replay, [K, B, N, A].
        """
        if self.config.joint_gradient == "own":
            n_agents = self.sizes.n_agents
            own = torch.eye(n_agents, dtype=torch.bool, device=pi.device)[:, :, None]
            pi = torch.where(own, pi[:, :, None], actions[:, :, None]).flatten(1, 2)
            x = x.repeat_interleave(n_agents, 1)
        joint = torch.cat([x, pi.flatten(2)], 2)
        return self.critics.frozen(joint, every=self.config.n_critics).mean(-1)

    def _update_critics(self, batch: Batch, x: Tensor, scale: float) -> dict[str, Tensor]:
        y = self.targets(batch)  # [K, B, N]
        q = self.q(self.critics, x, batch.actions)  # [K, J, B, N]
        errors = smooth_l1_loss(q, y[:, None].expand_as(q), reduction="none")
        loss = errors.mean((2, 3)).sum(1)  # [K]
        self.critic_optimizer.step(loss, scale)
        return {"critic_loss": loss, "q": q.mean((1, 2, 3))}

    def _update_actors(self, batch: Batch, x: Tensor, scale: float) -> dict[str, Tensor]:
        logits = self.actors(batch.observations)
        q = self.policy_values(x, logits.tanh(), batch.actions).mean(1)  # [K]
        size = logits.square().mean((1, 2, 3))
        self.actor_optimizer.step(self.config.logit_penalty * size - q, scale)
        return {"policy_q": q}

    def state_dict(self) -> dict[str, Tensor]:
        """Parameters, targets, Adam's moments, generators and number of updates, as copies."""
        return {
            "n_updates": torch.tensor(self.n_updates),
            "generators": generator_states(self.generators),
            **{name: network.flat.clone() for name, network in self._networks().items()},
            **{f"actor_adam.{k}": v for k, v in self.actor_optimizer.state_dict().items()},
            **{f"critic_adam.{k}": v for k, v in self.critic_optimizer.state_dict().items()},
        }

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Restores what `state_dict` returned."""
        self.n_updates = int(state["n_updates"])
        restore_generators(self.generators, state["generators"])
        for name, network in self._networks().items():
            network.load(state[name])
        self.actor_optimizer.load_state_dict(part(state, "actor_adam"))
        self.critic_optimizer.load_state_dict(part(state, "critic_adam"))

    def _networks(self) -> dict[str, StackedMLP]:
        return {
            "actors": self.actors.network,
            "critics": self.critics,
            "target_actors": self.target_actors,
            "target_critics": self.target_critics,
        }


def information(states: Tensor, observations: Tensor) -> Tensor:
    """Returns what the critics see besides actions: x = (s, o_1, ..., o_N), [K, B, S + N O].

    Args:
        states: normalized, [K, B, S].
        observations: normalized, [K, B, N, O].
    """
    return torch.cat([states, observations.flatten(2)], 2)
