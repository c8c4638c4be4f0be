"""MAPPO: PPO with shared actors and a centralised critic, for cooperative teams.

Yu et al., "The surprising effectiveness of PPO in cooperative multi-agent games", NeurIPS 2022
datasets and benchmarks (MAPPO); Schulman et al., "Proximal policy optimization algorithms", 2017
(PPO); Schulman et al., "High-dimensional continuous control using generalized advantage
estimation", ICLR 2016 (GAE). For robot i with observation o, action a, and a critic V that also
sees the state s:

    (1) delta = r + gamma (1 - termination) V(s', o') - V(s, o)        PPO, equation 12
    (2) A     = delta + gamma lambda (1 - end) A'                      GAE, equation 16
    (3) R     = A + V(s, o), standardized for each seed                MAPPO, section 5.1
    (4) ratio = pi(a | o) / pi_old(a | o)                              PPO, section 3
    (5) L(pi) = -mean min(ratio A, clip(ratio, 1 - c, 1 + c) A)        PPO, equation 7
    (6) L(V)  = mean Huber(V(s, o) - R)                                PPO, equation 9, second term

Two parts of MAPPO are off by default, with which the shipped policies were trained:
- `value_clip` c_V (MAPPO, section 5.4; 0.2 in its experiments) takes for (6) the larger of
  Huber(V - R) and Huber(V_old + clip(V - V_old, -c_V, c_V) - R), in units of standardized returns;
- `entropy_weight` (PPO, equation 9, third term; 0.01 in MAPPO's experiments) times the entropy of
  the actions' noise is subtracted from L(pi). It needs `learned_std`, since the entropy of a
  deviation that follows a schedule is a constant.

With `memory` gru, actors remember the running episode (recurrent MAPPO, appendix B: gated units,
gradients through segments of `window` steps; a segment begins with the memory that it had when the
rollout was made, which is not computed again in later epochs). The critic has no memory: it sees
the state, where the paper's critic remembers too.

Deviations:
- K seeds are trained at once, as an axis of every tensor;
- robots observe and act in the frame of their target (`frame`), which turns with them;
- the standard deviation of actions follows a schedule instead of being learned (`learned_std`: it
  collapses early and success stalls);
- action noise may be correlated from step to step (`noise_correlation`), since independent noise
  averages out. It is autoregressive of order 1 (Korenkevych et al., "Autoregressive policies for
  continuous control deep reinforcement learning", IJCAI 2019, section 4);
- every robot is trained on its own reward, which `shaping` changes;
- a small penalty on means outside [-1, 1], so that the clipped mean which is deployed is the one
  that was trained;
- training may start from other policies (`start`, or an offline run) or from a clone of a teacher;
  then only the critic learns at first (`critic_warmup_fraction`), since the advantages of an
  untrained critic would undo the clone. Recorded data are not mixed in;
- the actors rest in the first update, whose advantages are of a critic that knows nothing;
- the actor's and the critic's gradients are clipped separately.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import smooth_l1_loss

from swarmdata.errors import SpecError
from swarmdata.learn.memory.memory_settings import Memory
from swarmdata.learn.networks.network_inputs import generators as torch_generators
from swarmdata.learn.networks.optimizer import Descent
from swarmdata.learn.networks.perceptrons import StackedLayers
from swarmdata.learn.networks.team_networks import Parameters
from swarmdata.learn.policies.recurrent_policy import RecurrentPolicy
from swarmdata.learn.policies.torch_policy import TorchPolicy
from swarmdata.online_algos.actors.mean_actors import Actors, collection_state, restore_collection
from swarmdata.online_algos.actors.sample_rows import (
    minibatches,
    pick,
    sample_rows,
    sample_segments,
    seed_means,
)
from swarmdata.online_algos.collection.input_moments import measure_moments
from swarmdata.online_algos.collection.training_worlds import Worlds, standard_normal
from swarmdata.online_algos.continuation.offline_start import OfflineStart, actor_settings
from swarmdata.online_algos.ppo.initial_weights import StartConfig, initial_weights
from swarmdata.online_algos.ppo.networks import Critic, LearnedDeviation
from swarmdata.online_algos.ppo.rollouts import Rollout, critic_states, empty_rollout, fill_values
from swarmdata.online_algos.shaping.shaped_env import ShapingConfig, shape_rewards
from swarmdata.perception.frames import find_frame
from swarmdata.rollouts.side_env import AnyEnv, seen_in, whole_of
from swarmdata.specs.features import Feature
from swarmdata.types import Bool, Float, copy_step


@dataclass(frozen=True)
class MAPPOConfig:
    """Hyperparameters; steps are joint steps of one seed's worlds."""

    NEEDS: ClassVar[Mapping[str, Any]] = {
        **dict.fromkeys(("memory_size", "window"), ("memory", ("gru",))),
        "final_std": ("learned_std", (False,)),
    }

    n_steps: int = 2_000_000
    n_copies: int = 64  # for each seed
    rollout_steps: int = 64  # of each copy
    hidden: int = 64
    parameters: Parameters = "shared"
    frame: str = "target"  # see frames.find_frame
    learning_rate: float = 1e-3
    final_learning_rate: float = 5e-5
    discount: float = 0.985
    gae_lambda: float = 0.95
    n_epochs: int = 3
    minibatch: int = 2048  # samples of single robots
    clip: float = 0.2
    value_weight: float = 0.5
    max_grad_norm: float = 0.5
    value_clip: float | None = None  # c_V, of (6); None: not clipped
    std: float = 0.5
    final_std: float = 0.1  # without `learned_std`
    learned_std: bool = False  # from `std` on, one for each component
    entropy_weight: float = 0.0  # of the bonus; with `learned_std`
    noise_correlation: float = 0.0  # of action noise between steps, in [0, 1)
    mean_penalty: float = 0.05  # on means outside [-1, 1]
    memory: Memory = "none"  # of the actors
    memory_size: int = 64  # numbers that each robot remembers
    window: int = 16  # with a memory, steps of the segments through which gradients flow
    critic_warmup_fraction: float = 0.0  # part of training in which only the critic learns
    shaping: ShapingConfig = ShapingConfig()  # noqa: RUF009 - frozen
    start: StartConfig = StartConfig()  # noqa: RUF009 - frozen

    def __post_init__(self) -> None:
        if self.entropy_weight and not self.learned_std:
            raise SpecError(
                f"entropy_weight is {self.entropy_weight:g}, but the deviation of actions follows "
                "a schedule, so that their entropy is constant; set learned_std to true as well"
            )
        if self.memory != "none":
            self._check_memory()

    def _check_memory(self) -> None:
        if self.window > self.minibatch:
            raise SpecError(
                f"window is {self.window}, expected at most a minibatch ({self.minibatch})"
            )
        if self.rollout_steps % self.window:
            raise SpecError(
                f"rollout_steps is {self.rollout_steps}, expected a multiple of window "
                f"({self.window}), the steps of a segment"
            )
        if self.start.policies or self.start.has_teacher:
            raise SpecError(
                f"memory is {self.memory!r} and start is set: policies and clones to start from "
                "have no memory. Leave one of them out."
            )


WHEN_STARTED = {"std": "0.2", "critic_warmup_fraction": "0.1"}
"""Settings of a training that starts from an offline run, where the user gives no others.

The advantages of an untrained critic would undo the policy, and so would a beginner's noise."""


class MAPPO:
    """K training runs, one a seed, in K E copies of a task: rollouts and updates.

    `folder` stays empty: nothing is too large for a checkpoint.
    """

    Config = MAPPOConfig
    LOSSES = ("policy", "value", "kl", "reward", "std")

    def __init__(
        self, env: AnyEnv, seeds: Sequence[int], config: MAPPOConfig, folder: Path | None = None
    ) -> None:
        self.config, self.frames, self.seeds = config, 0, tuple(seeds)
        self.env = shape_rewards(whole_of(env), config.shaping)
        frame = find_frame(env.features, config.frame, env.spec.robots)
        self.worlds = Worlds(seen_in(self.env, env), seeds, frame)
        self.generators = [np.random.default_rng(seed) for seed in seeds]
        measuring = torch_generators(seeds, "cpu")
        moments = measure_moments(self.worlds, measuring, config.rollout_steps)
        sizes = self.worlds.sizes
        memory = (config.memory_size, config.window) if config.memory != "none" else (0, 1)
        self.actors = Actors(sizes, seeds, config.hidden, config.parameters, moments, *memory)
        n_inputs = self.actors.network.shape.inputs + sizes.state
        self.critic = Critic(n_inputs, seeds, config.hidden)
        self.deviation: LearnedDeviation | None = None
        trained: dict[str, StackedLayers] = {"actor": self.actors.network}
        if config.learned_std:
            self.deviation = LearnedDeviation(
                len(seeds) * self.actors.n_rows, sizes.action, config.std
            )
            trained["deviation"] = self.deviation.network
        self.actor_descent = Descent(trained, len(seeds), 1.0, config.max_grad_norm)
        self.critic_descent = Descent(
            {"critic": self.critic.network}, len(seeds), 1.0, config.max_grad_norm
        )
        shape = (len(seeds), self.worlds.n_copies, sizes.n_agents)
        # from the step before, [K, E, N, A] and [K, E, N, M]
        self._carried_noise = np.zeros((*shape, sizes.action), np.float32)
        self._memory = torch.zeros(*shape, self.actors.memory_size)

    @property
    def progress(self) -> float:
        return min(1.0, self.frames / self.config.n_steps)

    @property
    def std(self) -> float | Tensor:
        """Current standard deviation of the actions; of learned ones [K n_rows, 1, A]."""
        if self.deviation is not None:
            return self.deviation.std
        return self.config.std + (self.config.final_std - self.config.std) * self.progress

    @property
    def innovation_std(self) -> float | Tensor:
        """That of the noise which is not carried over from the step before."""
        return self.std * math.sqrt(1 - self.config.noise_correlation**2)

    @property
    def learning_rate(self) -> float:
        c = self.config
        return c.learning_rate + (c.final_learning_rate - c.learning_rate) * self.progress

    def prepare(self) -> bool:
        """Gives the actors the weights of `config.start`; returns whether a teacher was cloned."""
        start = self.config.start
        self.actors.load(
            initial_weights(start, self.actors, self.worlds, self.generators, self.seeds)
        )
        return start.has_teacher

    @staticmethod
    def settings_of(start: OfflineStart, features: Sequence[Feature]) -> dict[str, str]:
        return actor_settings(start, features) | WHEN_STARTED

    def start_from(self, start: OfflineStart) -> list[str]:
        if self.config.start != StartConfig():
            raise SpecError(
                f"the settings start.* name other policies or a teacher, but training starts from "
                f"{start.name}; leave one of them out"
            )
        self.actors.start_from(start, self.seeds, self.worlds.frame)
        return [f"The critic begins anew: {start.run.algorithm} has none of mappo's kind."]

    def update(self) -> dict[str, Tensor]:
        """One rollout and its gradient steps.

        Returns the losses of the last minibatches, NaN of actors that do not learn yet; the mean
        reward that was trained on; the standard deviation of the actions. Each [K].
        """
        c, std = self.config, self._mean_std()
        self.env.progress = self.progress
        rollout = self._collect()
        advantages = generalized_advantages(
            rollout.rewards, rollout.values, rollout.next_values,
            rollout.terminations, rollout.ended, c.discount, c.gae_lambda,
        )  # fmt: skip
        returns = advantages + rollout.values  # (3)
        old = self.critic.scale.normalize(rollout.values)
        self.critic.scale.update(returns)
        losses = self._descend(rollout, advantages, self.critic.scale.normalize(returns), old)
        self.frames += c.rollout_steps * c.n_copies
        reward = rollout.rewards.mean(axis=(0, 2, 3), dtype=np.float64)
        return {**losses, "reward": torch.from_numpy(reward), "std": std}

    def _collect(self) -> Rollout:
        """Acts for `rollout_steps` steps in all copies; those that end begin new episodes."""
        c, worlds, actors = self.config, self.worlds, self.actors
        n_inputs, memory_size = actors.network.shape.inputs, actors.memory_size
        r = empty_rollout(c.rollout_steps, n_inputs, memory_size, worlds)
        std, log_std = self._innovations()
        correlation = np.float32(c.noise_correlation)
        ends = []  # the last steps of episodes, whose values are bootstrapped from
        for t in range(c.rollout_steps):
            inputs = actors.inputs(worlds.observations(worlds.current_step))
            r.actor_inputs[t] = inputs
            r.states[t] = worlds.grouped(critic_states(worlds.current_step, worlds.first_robot))
            noise = standard_normal(self.generators, r.actions.shape[2:])
            r.memories[t] = self._memory
            means, self._memory = actors.act(inputs, self._memory)
            r.actions[t] = means.numpy() + std * noise
            r.log_probs[t] = (-0.5 * noise * noise - log_std).sum(-1)  # less A log(2 pi) / 2
            step = worlds.advance(r.actions[t] + self._carried_noise)
            self._carried_noise = correlation * (self._carried_noise + std * noise)
            r.rewards[t] = worlds.grouped(step.rewards)
            r.terminations[t], r.ended[t] = map(worlds.grouped, (step.terminations, step.ended))
            self._forget(r.ended[t])
            ends.append(copy_step(step, np.flatnonzero(step.ended)))
        fill_values(r, ends, worlds, actors, self.critic)
        return r

    def _forget(self, copies: Bool) -> None:
        """Clears what is carried from step to step where episodes begin, [K, E]."""
        self._carried_noise[copies] = 0
        self._memory[torch.from_numpy(copies)] = 0

    def _descend(
        self, r: Rollout, advantages: Float, returns: Float, old: Float
    ) -> dict[str, Tensor]:
        """Epochs of minibatches; the actors and the critic draw their own; all [T, K, E, N]."""
        c = self.config
        of_actors = self.actors.seen(r.actor_inputs, r.memories, r.ended) + [
            sample_segments(torch.from_numpy(x), c.parameters, self.actors.window)
            for x in (r.actions, r.log_probs, normalized(advantages))
        ]  # L steps each: [K, T E N / L, L, ...] or [K N, T E / L, L, ...]
        of_critic = [
            sample_rows(torch.from_numpy(x), "shared")
            for x in (np.concatenate([r.actor_inputs, r.states], -1), returns, old)
        ]  # [K, T E N, ...]
        losses = {name: torch.full((len(self.seeds),), torch.nan) for name in ("policy", "kl")}
        for _ in range(c.n_epochs):
            if self.progress > c.critic_warmup_fraction:
                losses |= self._actor_epoch(of_actors)
            losses |= self._critic_epoch(of_critic)
        return losses

    def _actor_epoch(self, samples: Sequence[Tensor]) -> dict[str, Tensor]:
        """One pass over segments [R, segments, ...] as of `_descend`; the last losses, [K]."""
        c, n_seeds, learned = self.config, len(self.seeds), self.deviation
        size = c.minibatch // self.actors.window
        for rows in minibatches(self.generators, samples[0].shape[1], self.actors.n_rows, size):
            *seen, taken, old, advantage = (pick(values, rows) for values in samples)
            actions, log_probs, advantages = (x.flatten(1, 2) for x in (taken, old, advantage))
            means = self.actors.again(*seen)  # [K n_rows, B, A]
            objective, kl = clipped_losses(
                means, actions, log_probs, advantages, std=self.innovation_std, clip=c.clip
            )
            loss = seed_means(objective, n_seeds)
            excess = seed_means((means.abs() - 1).clamp(min=0).square().mean(-1), n_seeds)
            total = loss + c.mean_penalty * excess
            if learned is not None:
                total = total - c.entropy_weight * seed_means(learned.entropy, n_seeds)
            self.actor_descent.step(total, self.learning_rate)
        return {"policy": loss.detach(), "kl": seed_means(kl, n_seeds)}

    def _critic_epoch(self, samples: Sequence[Tensor]) -> dict[str, Tensor]:
        """One pass over inputs, standardized returns and old outputs; the last loss, [K]."""
        c = self.config
        for rows in minibatches(self.generators, samples[0].shape[1], 1, c.minibatch):
            inputs, returns, old = (pick(values, rows) for values in samples)
            values = self.critic.network(inputs)[..., 0]  # [K, B]
            loss = value_losses(values, returns, old, c.value_clip).mean(1)  # (6)
            self.critic_descent.step(c.value_weight * loss, self.learning_rate)
        return {"value": loss.detach()}

    def _innovations(self) -> tuple[Float, Float]:
        """`innovation_std` and its logarithm, numbers or [K, 1, N, A]; 1 for N of shared actors."""
        std = self.innovation_std
        if isinstance(std, Tensor):
            by_robot = std.detach().view(len(self.seeds), 1, self.actors.n_rows, -1).numpy()
            return by_robot, np.log(by_robot)
        return np.asarray(std, np.float32), np.asarray(np.log(std), np.float32)

    def _mean_std(self) -> Tensor:
        """The standard deviation of the actions, a mean over components, [K]."""
        std = self.std
        if isinstance(std, Tensor):
            return seed_means(std.detach(), len(self.seeds))
        return torch.full((len(self.seeds),), std)

    def policy(self, index: int) -> TorchPolicy | RecurrentPolicy:
        return self.actors.policy(index, self.worlds.frame)

    def restart_worlds(self) -> None:
        self.worlds.restart()
        self._forget(np.ones(self._carried_noise.shape[:2], np.bool_))

    def state_dict(self) -> dict[str, Tensor]:
        """Everything but the running episodes, as tensors."""
        return {
            **self.actor_descent.state_dict(),
            **self.critic_descent.state_dict(),
            **collection_state(self),
            "scale": torch.from_numpy(self.critic.scale.moments.copy()),
        }

    def load_state_dict(self, state: Mapping[str, Tensor]) -> None:
        self.actor_descent.load_state_dict(state)
        self.critic_descent.load_state_dict(state)
        self.critic.scale.moments = state["scale"].numpy().copy()
        restore_collection(self, state)
        self._forget(np.ones(self._carried_noise.shape[:2], np.bool_))


def generalized_advantages(
    rewards: Float, values: Float, next_values: Float, terminations: Bool, ended: Bool,
    discount: float, gae_lambda: float,
) -> Float:  # fmt: skip
    """Advantages, bootstrapped through truncation and cut at every episode end, [T, C, N].

    C stands for any axes of copies. Rewards, values of the states acted in, and of the next states
    before any reset are [T, C, N]; terminations, after which nothing follows, and `ended`, by these
    or by truncation, [T, C].
    """
    deltas = rewards + discount * ~terminations[..., None] * next_values - values  # (1)
    advantages = np.zeros_like(deltas)
    following = np.zeros_like(deltas[0])
    for t in reversed(range(len(deltas))):
        following = deltas[t] + discount * gae_lambda * ~ended[t][..., None] * following  # (2)
        advantages[t] = following
    return advantages


def normalized(advantages: Float) -> Float:
    """Returns advantages [T, K, E, N] with mean 0 and standard deviation 1 for each seed."""
    mean = advantages.mean(axis=(0, 2, 3), keepdims=True, dtype=np.float64)
    std = advantages.std(axis=(0, 2, 3), keepdims=True, dtype=np.float64)
    return ((advantages - mean) / (std + 1e-6)).astype(np.float32)


def clipped_losses(
    means: Tensor, actions: Tensor, old_log_probs: Tensor, advantages: Tensor,
    *, std: float | Tensor, clip: float,
) -> tuple[Tensor, Tensor]:  # fmt: skip
    """Returns the negative clipped objective of each sample, and its divergence, two [R, B].

    The divergence estimates KL(old, new) by ratio - 1 - log ratio, which is never negative
    (Schulman, "Approximating KL divergence", 2020); it has no gradient. Means of the current
    policies and actions are [R, B, A], normalized advantages [R, B], std a number or [R, 1, A]. Old
    log-probabilities, [R, B], lack A log(2 pi) / 2, which cancels.
    """
    z = (actions - means) / std
    log_std = std.log() if isinstance(std, Tensor) else np.log(std)
    log_ratio = (-0.5 * z * z - log_std).sum(-1) - old_log_probs
    ratio = log_ratio.exp()  # (4)
    clipped = ratio.clamp(1 - clip, 1 + clip)
    losses = -torch.minimum(ratio * advantages, clipped * advantages)  # (5)
    return losses, (ratio - 1 - log_ratio).detach()


def value_losses(values: Tensor, returns: Tensor, old: Tensor, clip: float | None) -> Tensor:
    """Returns the loss of each value, [K, B]: (6), clipped or not, of standardized returns.

    With a clip c_V it is the larger of the losses of the value and of what the clip leaves of its
    change from the old one, so that a value that has moved too far has no gradient unless it moves
    back (the code of PPO2 and MAPPO). Values, returns and old values are [K, B].
    """
    losses: Tensor = smooth_l1_loss(values, returns, reduction="none")
    if clip is None:
        return losses
    near = old + (values - old).clamp(-clip, clip)
    return torch.maximum(losses, smooth_l1_loss(near, returns, reduction="none"))
