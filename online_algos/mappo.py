"""MAPPO: PPO with shared actors and a centralised critic, for cooperative teams.

Source: Yu et al., "The surprising effectiveness of PPO in cooperative multi-agent games", NeurIPS
2022 datasets and benchmarks; PPO's clipped objective is Schulman et al. 2017, equation 7; GAE is
Schulman et al. 2016, equation 16; value normalization is Yu et al., section 5.1.

Deviations, each measured on `coop_nav` or required by it:
- K seeds are trained at once, as an axis of every tensor;
- robots see and act in the frame of their target (`frame`), which turns with them;
- the standard deviation of actions follows a schedule instead of being learned (a learned one
  collapses early and success stalls);
- contact costs grow during training (`contact_cost`), since a high cost from the start prevents
  learning and a low one leaves a policy that brushes past obstacles;
- every robot is trained on its own reward, mixed with the team mean by `team_share`;
- a small penalty on means outside [-1, 1], so that the clipped mean which is deployed is the one
  that was trained;
- training may start from a clone of a teacher (`warm_start`); then only the critic learns at first,
  since the advantages of an untrained critic would undo the clone;
  the longer the clone (`clone_rounds`), the less is left to learn: with 10 and 48 rounds, 4 clones
  of `formation-expert` solve 96 and 99 % of 128 episodes each, 48 and 85 % without a touch;
- inputs are normalized by statistics that are frozen from the start, so that the trained actor is
  one fixed piecewise linear function;
- the actor's and the critic's gradients are clipped separately.

Two more are for `transport`:
- action noise may remember that of the step before (`noise_memory`), since noise that is new in
  every step averages out. It is autoregressive of order 1 (Korenkevych et al., "Autoregressive
  policies for continuous control deep reinforcement learning", IJCAI 2019, section 4). A million
  steps of `transport-expert`, two seeds: 1.1 and 1.4 robot collisions an episode, 1.8 and 2.3 with
  `noise_memory=0`; success is about the same, 77 and 73, 70 and 79 %;
- a payload's progress may be rewarded along its way around obstacles, and robots for getting
  behind it on that way (`detour`, `behind`, see `detours`).
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import smooth_l1_loss

from swarmdata.errors import SpecError
from swarmdata.interfaces import VecEnv
from swarmdata.learn.networks.network_inputs import generators as torch_generators
from swarmdata.learn.networks.network_inputs import standardize, with_agent_id
from swarmdata.learn.networks.optimizer import StackedAdam
from swarmdata.learn.networks.perceptrons import MLPShape, StackedMLP, initialize
from swarmdata.learn.networks.team_networks import Parameters, by_network, from_rows
from swarmdata.learn.policies.torch_policy import TorchPolicy
from swarmdata.learn.training.checkpoint import part
from swarmdata.online_algos.collection.input_moments import measure_moments
from swarmdata.online_algos.collection.seed_generators import (
    pack_generators,
    standard_normal,
    unpack_generators,
)
from swarmdata.online_algos.collection.training_worlds import Worlds, reweighted
from swarmdata.online_algos.ppo.advantages import TargetScale, generalized_advantages, normalized
from swarmdata.online_algos.ppo.clipping import clipped_losses
from swarmdata.online_algos.ppo.initial_weights import start_actors
from swarmdata.online_algos.ppo.rollout_samples import (
    Rollout,
    critic_states,
    empty_rollout,
    minibatches,
    pad_by_seed,
    pick,
    ranks,
    sample_rows,
    seed_means,
)
from swarmdata.online_algos.shaping.payload_potentials import Detours
from swarmdata.online_algos.shaping.shaping import Shaping
from swarmdata.perception.frames import find_frame
from swarmdata.types import Float, Int, Step, copy_step


@dataclass(frozen=True)
class MAPPOConfig:
    """Hyperparameters; frames are joint steps of one seed's worlds."""

    n_frames: int = 2_000_000
    n_copies: int = 64  # for each seed
    n_steps: int = 64  # per rollout and copy
    hidden: int = 64
    parameters: Parameters = "shared"
    frame: str = "target"  # see frames.find_frame
    learning_rate: float = 1e-3
    final_learning_rate: float = 5e-5
    discount: float = 0.985
    gae_lambda: float = 0.95
    n_epochs: int = 3
    minibatch: int = 2048  # robot samples
    clip: float = 0.2
    value_weight: float = 0.5
    max_grad_norm: float = 0.5
    std: float = 0.5
    final_std: float = 0.1
    noise_memory: float = 0.0  # correlation of action noise between steps, in [0, 1)
    team_share: float = 0.3
    mean_penalty: float = 0.05  # on means outside [-1, 1]
    critic_warmup: float = 0.0  # part of training in which only the critic learns
    start: str = ""  # a run's folder or a shipped tier that the actors start from; empty for none
    teacher: str = ""  # registered policy that the actor first clones; empty for none
    teacher_remembers: bool = True  # else it is reset in each step: labels then fit the step alone
    clone_rounds: int = 10  # rounds of states that the teacher labels
    clone_noise: float = 0.1  # standard deviation of actions in these rounds
    contact_cost: float = 4.0  # extra weight of contacts and collisions at last, times the spec's
    contact_ramp: tuple[float, float] = (0.2, 0.75)  # part of training in which it grows from 0
    keep_right: float = 0.0  # cost in each step of an oncoming robot on the right
    keep_left: float = 0.0  # the same on the left
    detour: float = 0.0  # reward for each metre by which a payload's way around obstacles shrinks
    behind: float = 0.0  # reward for getting from before to behind a payload on that way, times 2
    rewards: tuple[str, ...] = ()  # weights to train with, such as "proximity=2", not the spec's


ACTOR_STREAM, CRITIC_STREAM = 0, 1
"""Streams of a seed's initial parameters."""


class MAPPO:
    """K training runs: rollouts and updates.

    Args:
        env: K E copies of the task.
        seeds: of everything random in each run, [K].
        config: hyperparameters.
        folder: unused, as nothing is too large for a checkpoint.

    Raises:
        SpecError: `noise_memory` is no correlation, or a payload's way is rewarded where there is
            no payload.
    """

    Config = MAPPOConfig
    LOSSES = ("policy", "value", "kl", "reward", "std")

    def __init__(
        self, env: VecEnv, seeds: Sequence[int], config: MAPPOConfig, folder: Path | None = None
    ) -> None:
        if not 0.0 <= config.noise_memory < 1.0:
            raise SpecError(
                f"noise_memory is {config.noise_memory:g}, expected at least 0, below 1"
            )
        self.config, self.frames, self.seeds = config, 0, tuple(seeds)
        self._shaping = Shaping.of(config)
        env = reweighted(env, config.rewards)
        self.worlds = Worlds(env, seeds, find_frame(env.features, config.frame))
        self.generators = [np.random.default_rng(seed) for seed in seeds]
        moments = measure_moments(self.worlds, torch_generators(seeds, "cpu"), config.n_steps)
        self.input_mean, self.input_std = moments[:2]  # of observations, [K, O]
        sizes = self.worlds.sizes
        # the part of each action's noise that the step before it has decided, [K, E, N, A]
        self._drift = np.zeros(
            (len(seeds), self.worlds.n_copies, sizes.n_agents, sizes.action), np.float32
        )
        self._all_copies = np.arange(env.n_copies)
        has_ways = config.detour or config.behind
        self._detours = Detours(env.spec, self.worlds.present) if has_ways else None
        hidden = (config.hidden, config.hidden)
        self.n_rows = 1 if config.parameters == "shared" else sizes.n_agents  # actors of each seed
        n_own = sizes.observation + (sizes.n_agents if self.n_rows == 1 else 0)
        self.actor = StackedMLP(
            MLPShape(n_own, hidden, sizes.action), len(seeds) * self.n_rows, "cpu"
        )
        self.critic = StackedMLP(MLPShape(n_own + sizes.state, hidden, 1), len(seeds), "cpu")
        initialize(self.actor, seeds, ACTOR_STREAM, method="orthogonal", head_gain=0.01)
        initialize(self.critic, seeds, CRITIC_STREAM, method="orthogonal", head_gain=1.0)
        self.actor_adam, self.critic_adam = (
            StackedAdam(network, len(seeds), 1.0, config.max_grad_norm)
            for network in (self.actor, self.critic)
        )
        self.scale = TargetScale(len(seeds))

    @property
    def progress(self) -> float:
        """Part of the training that is done, in [0, 1]."""
        return min(1.0, self.frames / self.config.n_frames)

    @property
    def std(self) -> float:
        """Present standard deviation of the actions."""
        return self.config.std + (self.config.final_std - self.config.std) * self.progress

    @property
    def innovation(self) -> float:
        """Present standard deviation of what is new in the noise of a step."""
        return self.std * math.sqrt(1 - self.config.noise_memory**2)

    @property
    def learning_rate(self) -> float:
        """Present step size of Adam."""
        c = self.config
        return c.learning_rate + (c.final_learning_rate - c.learning_rate) * self.progress

    def update(self) -> dict[str, Tensor]:
        """One rollout and its gradient steps.

        Returns:
            The losses of the last minibatches, NaN of actors that do not learn yet; the mean
            reward that was trained on; the standard deviation of the actions. Each [K].
        """
        std = torch.full((len(self.generators),), self.std)
        rollout = self._collect()
        c = self.config
        advantages = generalized_advantages(
            rollout.rewards, rollout.values, rollout.next_values,
            rollout.terminations, rollout.ended, c.discount, c.gae_lambda,
        )  # fmt: skip
        targets = advantages + rollout.values
        self.scale.update(targets)
        losses = self._descend(rollout, advantages, self.scale.normalize(targets))
        self.frames += c.n_steps * c.n_copies  # after: the loss is of the deviation that acted
        reward = rollout.rewards.mean(axis=(0, 2, 3), dtype=np.float64)
        return {**losses, "reward": torch.from_numpy(reward), "std": std}

    def inputs(self, seen: Float) -> Tensor:
        """Normalized observations, [K, E, N, I]; with the robot's number if they share an actor."""
        mean, std = (torch.from_numpy(m)[:, None, None] for m in (self.input_mean, self.input_std))
        features = standardize(torch.from_numpy(seen), mean, std)
        return with_agent_id(features) if self.config.parameters == "shared" else features

    def means(self, own: Tensor) -> Tensor:
        """Mean actions of the present actors, [K, E, N, A], of inputs [K, E, N, I]."""
        with torch.no_grad():
            out = self.actor(by_network(own, self.config.parameters))
        return from_rows(out, own.shape, self.config.parameters)

    def policy(self, index: int) -> TorchPolicy:
        """The greedy policy of seed number `index`, a copy of its parameters as they are now."""
        return TorchPolicy(
            layers=self.actor.extract(index * self.n_rows, torch.float64, self.n_rows),
            observation_mean=torch.from_numpy(self.input_mean[index].astype(np.float64)),
            observation_std=torch.from_numpy(self.input_std[index].astype(np.float64)),
            squash=False,
            frame=self.worlds.frame,
            parameters=self.config.parameters,
        )

    def warm_start(self) -> bool:
        """Takes over the policies of another run, then clones the teacher, if there is one."""
        start_actors(self)
        self._begin_episodes(self._all_copies)
        return bool(self.config.teacher)

    def restart_worlds(self) -> None:
        """Begins new episodes everywhere, as loading a state does."""
        self.worlds.restart()
        self._begin_episodes(self._all_copies)

    def state_dict(self) -> dict[str, Tensor]:
        """Everything but the running episodes, as tensors."""
        return {
            "actor": self.actor.flat.clone(),
            "critic": self.critic.flat.clone(),
            **{f"actor_adam.{k}": v for k, v in self.actor_adam.state_dict().items()},
            **{f"critic_adam.{k}": v for k, v in self.critic_adam.state_dict().items()},
            **{f"worlds.{k}": v for k, v in self.worlds.state_dict().items()},
            "input.mean": torch.from_numpy(self.input_mean.copy()),
            "input.std": torch.from_numpy(self.input_std.copy()),
            "scale": self.scale.tensor(),
            "frames": torch.tensor(self.frames),
            "generators": pack_generators(self.generators),
        }

    def load_state_dict(self, state: Mapping[str, Tensor]) -> None:
        """Restores what `state_dict` returned and starts new episodes."""
        self.actor.load(state["actor"])
        self.critic.load(state["critic"])
        self.actor_adam.load_state_dict(part(state, "actor_adam"))
        self.critic_adam.load_state_dict(part(state, "critic_adam"))
        self.input_mean = state["input.mean"].numpy().copy()
        self.input_std = state["input.std"].numpy().copy()
        self.scale.moments = state["scale"].numpy().copy()
        self.frames = int(state["frames"])
        unpack_generators(state["generators"], self.generators)
        self.worlds.load_state_dict(part(state, "worlds"))
        self._begin_episodes(self._all_copies)

    def rewards(self, before: Step, step: Step) -> Float:
        """Rewards with the team share, the present extra cost of contacts and ways, [K, E, N].

        Args:
            before: the step that was acted in.
            step: what was reached.
        """
        weights = self.worlds.env.spec.rules.rewards
        rewards = self._shaping.rewards(step, weights, self.progress)
        if self._detours is not None:
            progress = self._detours.progress(before, step)[:, None]
            behind = self._detours.behind(step) - self._detours.behind(before)
            extra = self.config.detour * progress + self.config.behind * behind
            rewards = rewards + extra.astype(np.float32)
        return self.worlds.grouped(rewards)

    def _begin_episodes(self, copies: Int) -> None:
        """New episodes have begun in some copies of all seeds' worlds."""
        self._drift.reshape(-1, *self._drift.shape[2:])[copies] = 0
        if self._detours is not None:
            self._detours.begin(self.worlds.present, copies)

    def _collect(self) -> Rollout:
        c, worlds = self.config, self.worlds
        r = empty_rollout(c.n_steps, self.actor.shape.inputs, worlds)
        std, log_std = np.float32(self.innovation), np.float32(np.log(self.innovation))
        memory = np.float32(c.noise_memory)
        ends = []
        for t in range(c.n_steps):
            own = self.inputs(worlds.seen(worlds.present))
            r.own[t] = own
            r.states[t] = worlds.grouped(critic_states(worlds.present))
            noise = standard_normal(self.generators, r.actions.shape[2:])
            r.actions[t] = self.means(own).numpy() + std * noise
            r.log_probs[t] = (-0.5 * noise * noise - log_std).sum(-1)
            before = worlds.present
            reached = worlds.advance(r.actions[t] + self._drift)
            self._drift = memory * (self._drift + std * noise)
            r.rewards[t] = self.rewards(before, reached)
            r.terminations[t], r.ended[t] = worlds.ended(reached)
            over = np.flatnonzero(reached.ended)
            ends.append(copy_step(reached, over))
            self._begin_episodes(over)
        self._add_values(r, ends)
        return r

    def _add_values(self, r: Rollout, ends: Sequence[Step]) -> None:
        """Writes the values of all states acted in, and of those that were reached.

        Args:
            r: the rollout.
            ends: of each time, what the copies that ended have reached, which is not acted in.
        """
        worlds = self.worlds
        r.values[:] = self._values(torch.from_numpy(r.own), torch.from_numpy(r.states))
        own = self.inputs(worlds.seen(worlds.present))[None]
        states = torch.from_numpy(worlds.grouped(critic_states(worlds.present)))[None]
        r.next_values[:] = np.concatenate([r.values[1:], self._values(own, states)])
        t, k, e = np.nonzero(r.ended)
        if len(t):
            reached = Step._make(map(np.concatenate, zip(*ends, strict=True)))
            own = self.inputs(pad_by_seed(worlds.view(reached), k, worlds.n_seeds))
            states = torch.from_numpy(pad_by_seed(critic_states(reached), k, worlds.n_seeds))
            r.next_values[t, k, e] = self._values(own[None], states[None])[0][k, ranks(k)]

    def _values(self, own: Tensor, states: Tensor) -> Float:
        """Values in units of return, [T, K, E, N]."""
        t, k, e, n = own.shape[:4]
        with torch.no_grad():
            flat = self.critic(sample_rows(torch.cat([own, states], -1), "shared"))
        return self.scale.denormalize(flat.view(k, t, e, n).transpose(0, 1).numpy())

    def _descend(self, r: Rollout, advantages: Float, targets: Float) -> dict[str, Tensor]:
        """Epochs of minibatch steps on the clipped objective."""
        c = self.config
        tensors = (r.own, r.actions, r.log_probs, normalized(advantages))
        own, actions, log_probs, advantage = (
            sample_rows(torch.from_numpy(x), c.parameters) for x in tensors
        )
        seen = sample_rows(torch.from_numpy(np.concatenate([r.own, r.states], -1)), "shared")
        target = sample_rows(torch.from_numpy(targets), "shared")
        n_seeds = len(self.generators)
        losses = {name: torch.full((n_seeds,), torch.nan) for name in ("policy", "kl")}
        for _ in range(c.n_epochs):
            if self.progress > c.critic_warmup:
                for rows in minibatches(self.generators, own.shape[1], self.n_rows, c.minibatch):
                    batch = (pick(x, rows) for x in (own, actions, log_probs, advantage))
                    losses |= self._actor_step(*batch)
            for rows in minibatches(self.generators, seen.shape[1], 1, c.minibatch):
                losses |= self._critic_step(pick(seen, rows), pick(target, rows))
        return losses

    def _actor_step(
        self, own: Tensor, actions: Tensor, old_log_probs: Tensor, advantage: Tensor
    ) -> dict[str, Tensor]:
        """Schulman et al. 2017, equation 7."""
        c, n_seeds = self.config, len(self.generators)
        mean = self.actor(own)  # [K n_rows, B, A]
        losses, kl = clipped_losses(
            mean, actions, old_log_probs, advantage, std=self.innovation, clip=c.clip
        )
        policy_loss = seed_means(losses, n_seeds)
        excess = seed_means((mean.abs() - 1).clamp(min=0).square().mean(-1), n_seeds)
        self.actor_adam.step(policy_loss + c.mean_penalty * excess, self.learning_rate)
        return {"policy": policy_loss.detach(), "kl": seed_means(kl, n_seeds)}

    def _critic_step(self, seen: Tensor, target: Tensor) -> dict[str, Tensor]:
        """Schulman et al. 2017, equation 9, with a smooth-L1 loss."""
        value = self.critic(seen)[..., 0]  # [K, B]
        loss = smooth_l1_loss(value, target, reduction="none").mean(1)
        self.critic_adam.step(self.config.value_weight * loss, self.learning_rate)
        return {"value": loss.detach()}
