"""MAPPO: PPO with a shared actor and a centralised critic, for cooperative teams.

Source: Yu et al., "The surprising effectiveness of PPO in cooperative multi-agent games", NeurIPS
2022 datasets and benchmarks; PPO's clipped objective is Schulman et al. 2017, equation 7; GAE is
Schulman et al. 2016, equation 16; value normalisation is Yu et al., section 5.1.

Deviations, each measured on `coop_nav` or required by it:
- the standard deviation of actions follows a schedule instead of being learned (a learned one
  collapses early and success stalls);
- contact costs grow during training (`contact_cost`), since a high cost from the start prevents
  learning and a low one leaves a policy that brushes past obstacles;
- every robot is trained on its own reward, mixed with the team mean by `team_share`;
- an early stop of an epoch loop on a large policy change (`max_kl`), and a small penalty on means
  outside [-1, 1], so that the clipped mean which is deployed is the one that was trained;
- training may start from a clone of a teacher (`warm_start`); then only the critic learns at first,
  since the advantages of an untrained critic would undo the clone;
- inputs are normalised by the statistics of the first rollout, then frozen, so that the trained
  actor is one fixed piecewise linear function.
"""

import json
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from swarmdata.interfaces import VecEnv
from swarmdata.seeding import EVALUATION_BASE, derive
from swarmdata.states import N_COLUMNS, robots_of
from swarmdata.types import Bool, Float, Step, copy_step


@dataclass(frozen=True)
class Config:
    """Hyperparameters; frames are joint steps of one world."""

    n_frames: int = 16_000_000
    n_copies: int = 64
    n_steps: int = 64  # per rollout and copy
    hidden: int = 128
    learning_rate: float = 1e-3
    final_learning_rate: float = 5e-5
    discount: float = 0.985
    gae_lambda: float = 0.95
    n_epochs: int = 3
    minibatch: int = 2048
    clip: float = 0.2
    max_kl: float = 0.05
    value_weight: float = 0.5
    max_grad_norm: float = 0.5
    std: float = 0.5
    final_std: float = 0.1
    team_share: float = 0.3
    mean_penalty: float = 0.05  # on means outside [-1, 1]
    critic_warmup: float = 0.0  # part of training in which only the critic learns
    teacher: str = ""  # registered policy that the actor first clones; empty for none
    contact_cost: float = (
        5.0  # final extra weight of contacts and collisions, in units of the spec's
    )
    contact_ramp: tuple[float, float] = (0.2, 0.75)  # part of training in which it grows from 0


class Rollout(NamedTuple):
    """What one rollout collected, time first; P is the critic's input size."""

    observations: Float  # [T, E, N, O + N]
    critic_inputs: Float  # [T, E, N, P]
    actions: Float  # [T, E, N, A]
    log_probs: Float  # [T, E, N]
    rewards: Float  # [T, E, N]
    values: Float  # [T, E, N]
    next_values: Float  # [T, E, N] of the state reached, before any reset
    terminations: Bool  # [T, E]
    ended: Bool  # [T, E]


def _empty_rollout(
    shape: tuple[int, int, int], n_own: int, n_critic: int, n_actions: int
) -> Rollout:
    """A rollout of zeros, shape [T, E, N]."""

    def zeros(*features: int) -> Float:
        return np.zeros((*shape, *features), np.float32)

    flags = [np.zeros(shape[:2], np.bool_) for _ in range(2)]
    figures = [zeros() for _ in range(4)]
    return Rollout(zeros(n_own), zeros(n_critic), zeros(n_actions), *figures, *flags)  # type: ignore[arg-type]


def generalized_advantages(
    rewards: Float,
    values: Float,
    next_values: Float,
    terminations: Bool,
    ended: Bool,
    discount: float,
    lam: float,
) -> Float:
    """Advantages by GAE, bootstrapped through truncation and cut at every episode end.

    Args:
        rewards: [T, E, N].
        values: of the state acted in, [T, E, N].
        next_values: of the state reached, before any reset, [T, E, N].
        terminations: the task ended, so nothing follows, [T, E].
        ended: the episode ended, by termination or truncation, [T, E].
        discount: gamma.
        lam: lambda.
    """
    deltas = rewards + discount * ~terminations[..., None] * next_values - values
    advantages = np.zeros_like(deltas)
    running = np.zeros_like(deltas[0])
    for t in reversed(range(len(deltas))):
        running = deltas[t] + discount * lam * ~ended[t][:, None] * running
        advantages[t] = running
    return advantages


class RunningScale:
    """Mean and standard deviation of value targets, averaged over updates."""

    def __init__(self, decay: float = 0.99) -> None:
        self.decay, self.weight, self.first, self.second = decay, 0.0, 0.0, 0.0

    def update(self, values: Float) -> None:
        """Takes in one batch of targets."""
        keep, new = self.decay, 1 - self.decay
        self.first = keep * self.first + new * float(values.mean())
        self.second = keep * self.second + new * float(np.square(values).mean())
        self.weight = keep * self.weight + new

    @property
    def mean(self) -> float:
        """Mean of past targets."""
        return self.first / max(self.weight, 1e-8)

    @property
    def std(self) -> float:
        """Standard deviation of past targets, at least 0.01."""
        return max(self.second / max(self.weight, 1e-8) - self.mean**2, 1e-4) ** 0.5


def mlp(sizes: tuple[int, ...], last_gain: float) -> nn.Sequential:
    """A ReLU network with orthogonal weights; actors take a small last gain (Yu et al.)."""
    layers: list[nn.Module] = []
    for k, (n_in, n_out) in enumerate(pairwise(sizes)):
        linear = nn.Linear(n_in, n_out)
        last = k == len(sizes) - 2
        nn.init.orthogonal_(linear.weight, last_gain if last else 2**0.5)
        nn.init.zeros_(linear.bias)
        layers += [linear] if last else [linear, nn.ReLU()]
    return nn.Sequential(*layers)


def own_first_states(step: Step) -> Float:
    """Each robot's view of the state: itself, the others in cyclic order, the rest, [E, N, S]."""
    n = step.rewards.shape[1]
    order = (np.arange(n)[:, None] + np.arange(n)) % n
    rows = robots_of(step.states, n)[:, order].reshape(len(step.states), n, -1)
    own = step.states[:, N_COLUMNS * n :]
    return np.concatenate([rows, np.repeat(own[:, None], n, axis=1)], axis=-1)


class MAPPO:
    """One training run: rollouts and updates. `train` in `swarmdata.online_algos.training` loops.

    Args:
        env: the worlds to train in.
        config: hyperparameters.
        seed: of everything random in this run.
    """

    def __init__(self, env: VecEnv, config: Config, seed: int) -> None:
        self.env, self.config, self.frames = env, config, 0
        n, o = env.spec.n_agents, env.observation_size
        torch.manual_seed(seed)
        self.actor = mlp((o + n, config.hidden, config.hidden, env.action_size), 0.01)
        self.critic = mlp((o + n + env.state_size, config.hidden, config.hidden, 1), 1.0)
        self.parameters = [*self.actor.parameters(), *self.critic.parameters()]
        self.optimizer = torch.optim.Adam(
            self.parameters, lr=config.learning_rate, eps=1e-5, fused=True
        )
        self.scale = RunningScale()
        self.generator = np.random.default_rng(seed)
        self._seed, self._episodes = seed, 0
        self.present = env.reset(self._next_seeds(env.n_copies))
        self.input_mean, self.input_scale = self._measure_inputs()

    @property
    def progress(self) -> float:
        """Part of the training that is done, in [0, 1]."""
        return min(1.0, self.frames / self.config.n_frames)

    @property
    def std(self) -> float:
        """Present standard deviation of the actions."""
        return self.config.std + (self.config.final_std - self.config.std) * self.progress

    def update(self) -> dict[str, float]:
        """One rollout and its gradient steps; returns losses and rollout figures."""
        rollout = self._collect()
        self.frames += rollout.ended.size
        c = self.config
        for group in self.optimizer.param_groups:
            group["lr"] = (
                c.learning_rate + (c.final_learning_rate - c.learning_rate) * self.progress
            )
        advantages = generalized_advantages(
            rollout.rewards, rollout.values, rollout.next_values,
            rollout.terminations, rollout.ended, c.discount, c.gae_lambda,
        )  # fmt: skip
        targets = advantages + rollout.values
        self.scale.update(targets)
        losses = self._descend(rollout, advantages, (targets - self.scale.mean) / self.scale.std)
        return losses | {"reward": float(rollout.rewards.mean())}

    def restart_worlds(self) -> None:
        """Starts new episodes everywhere: after checkpoints, so that a resumed run is the same."""
        self.present = self.env.reset(self._next_seeds(self.env.n_copies))

    def actor_layers(self) -> list[tuple[Float, Float]]:
        """Weight [in, out] and bias [out] of each layer of the actor."""
        linears = [module for module in self.actor if isinstance(module, nn.Linear)]
        return [
            (m.weight.detach().numpy().T.copy(), m.bias.detach().numpy().copy()) for m in linears
        ]

    def state_dict(self) -> dict[str, Tensor]:
        """Everything but the running episodes, as tensors; see `restart_worlds`."""
        tensors = {f"actor.{k}": v for k, v in self.actor.state_dict().items()}
        tensors |= {f"critic.{k}": v for k, v in self.critic.state_dict().items()}
        for index, moments in self.optimizer.state_dict()["state"].items():
            tensors |= {f"adam.{index}.{name}": value for name, value in moments.items()}
        tensors |= {
            "input.mean": torch.from_numpy(self.input_mean),
            "input.scale": torch.from_numpy(self.input_scale),
        }
        scale = [self.scale.weight, self.scale.first, self.scale.second]
        tensors["scale"] = torch.tensor(scale, dtype=torch.float64)
        tensors["counters"] = torch.tensor([self.frames, self._episodes])
        generator = json.dumps(self.generator.bit_generator.state).encode()
        tensors["generator"] = torch.from_numpy(np.frombuffer(generator, np.uint8).copy())
        return {name: tensor.clone() for name, tensor in tensors.items()}

    def load_state_dict(self, state: dict[str, Tensor]) -> None:
        """Restores what `state_dict` returned and starts new episodes."""

        def part(prefix: str) -> dict[str, Tensor]:
            return {k.removeprefix(prefix): v for k, v in state.items() if k.startswith(prefix)}

        self.actor.load_state_dict(part("actor."))
        self.critic.load_state_dict(part("critic."))
        moments: dict[int, dict[str, Tensor]] = {}
        for name, value in part("adam.").items():
            index, field = name.split(".")
            moments.setdefault(int(index), {})[field] = value.clone()  # Adam keeps it
        groups = self.optimizer.state_dict()["param_groups"]
        self.optimizer.load_state_dict({"state": moments, "param_groups": groups})
        self.input_mean, self.input_scale = (
            state["input.mean"].numpy(),
            state["input.scale"].numpy(),
        )
        self.scale.weight, self.scale.first, self.scale.second = state["scale"].tolist()
        self.frames, self._episodes = (int(value) for value in state["counters"])
        self.generator.bit_generator.state = json.loads(bytes(state["generator"].tolist()))
        self.restart_worlds()

    def _next_seeds(self, count: int) -> Any:
        """Fresh training seeds, far from the reserved evaluation seeds."""
        counters = np.arange(self._episodes, self._episodes + count, dtype=np.uint64)
        self._episodes += count
        return derive(np.uint64(self._seed), counters) % np.uint64(EVALUATION_BASE)

    def _measure_inputs(self) -> tuple[Float, Float]:
        """Mean and inverse deviation of observations under random actions; constants keep 1."""
        env, seen = self.env, []
        for _ in range(self.config.n_steps):
            actions = self.generator.uniform(
                -1, 1, (env.n_copies, env.spec.n_agents, env.action_size)
            )
            seen.append(self.advance(actions)[0].observations)
        rows = np.concatenate(seen).reshape(-1, env.observation_size).astype(np.float64)
        std = rows.std(0)
        scale = np.where(std > 1e-3, 1 / np.maximum(std, 1e-3), 1.0)
        return rows.mean(0).astype(np.float32), scale.astype(np.float32)

    def advance(self, actions: Any) -> tuple[Step, Step]:
        """Steps the worlds; returns the step reached and the one after resetting ended copies."""
        reached = self.env.step(actions)
        ended = np.flatnonzero(reached.ended)
        self.present = (
            self.env.reset(self._next_seeds(len(ended)), ended) if len(ended) else reached
        )
        return reached, self.present

    def inputs(self, step: Step) -> tuple[Float, Float]:
        """Actor inputs: normalised observations and ids; critic inputs: states as well."""
        e, n = step.rewards.shape
        seen = (step.observations - self.input_mean) * self.input_scale
        ids = np.broadcast_to(np.eye(n, dtype=np.float32), (e, n, n))
        own = np.concatenate([seen, ids], -1)
        return own, np.concatenate([own, own_first_states(step) * np.float32(0.5)], -1)

    def _value(self, critic_inputs: Float) -> Float:
        """Values in units of return."""
        with torch.inference_mode():
            flat = self.critic(torch.from_numpy(critic_inputs.reshape(-1, critic_inputs.shape[-1])))
        return flat.numpy().reshape(critic_inputs.shape[:-1]) * self.scale.std + self.scale.mean

    def _train_rewards(self, step: Step) -> Float:
        """Rewards with the team share and the present extra cost of contacts, [E, N]."""
        c, w = self.config, self.env.spec.rules.rewards
        begin, end = c.contact_ramp
        extra = c.contact_cost * min(1.0, max(0.0, (self.progress - begin) / (end - begin)))
        costs = np.array(
            [w.robot_contact, w.obstacle_contact, w.robot_collision, w.obstacle_collision],
            np.float32,
        )
        rewards = step.rewards - extra * (step.events @ costs)
        return (1 - c.team_share) * rewards + c.team_share * rewards.mean(1, keepdims=True)

    def _collect(self) -> Rollout:
        t_max, e, n = self.config.n_steps, self.env.n_copies, self.env.spec.n_agents
        actor_in, critic_in = self.inputs(self.present)
        r = _empty_rollout(
            (t_max, e, n), actor_in.shape[-1], critic_in.shape[-1], self.env.action_size
        )
        std = np.float32(self.std)
        for t in range(t_max):
            r.observations[t], r.critic_inputs[t] = actor_in, critic_in
            with torch.inference_mode():
                mean = self.actor(torch.from_numpy(actor_in)).numpy()
            noise = self.generator.standard_normal(mean.shape, dtype=np.float32)
            r.actions[t] = mean + std * noise
            r.log_probs[t] = (-0.5 * noise * noise - np.log(std)).sum(-1)
            reached, step = self.advance(r.actions[t])
            r.rewards[t] = self._train_rewards(reached)
            r.terminations[t], r.ended[t] = reached.terminations, reached.ended
            ended = np.flatnonzero(reached.ended)
            if len(ended):
                r.next_values[t, ended] = self._value(self.inputs(copy_step(reached, ended))[1])
            actor_in, critic_in = self.inputs(step)
        r.values[:] = self._value(r.critic_inputs)
        following = np.concatenate([r.values[1:], self._value(critic_in)[None]])
        r.next_values[~r.ended] = following[~r.ended]
        return r

    def _descend(self, rollout: Rollout, advantages: Float, targets: Float) -> dict[str, float]:
        """Epochs of minibatch steps on the clipped objective; stops early on a large change."""
        c, std = self.config, self.std
        flat = [torch.from_numpy(x.reshape(-1, x.shape[-1])) for x in rollout[:3]]
        observations, critic_inputs, actions = flat
        old_log_probs, advantage, target = (
            torch.from_numpy(x.reshape(-1)) for x in (rollout.log_probs, advantages, targets)
        )
        advantage = (advantage - advantage.mean()) / (advantage.std() + 1e-6)
        losses: dict[str, float] = {}
        for _ in range(c.n_epochs):
            order = torch.from_numpy(self.generator.permutation(len(actions)))
            for rows in torch.split(order, c.minibatch):
                loss, losses = self._loss(
                    observations[rows], critic_inputs[rows], actions[rows],
                    old_log_probs[rows], advantage[rows], target[rows], std,
                )  # fmt: skip
                self.optimizer.zero_grad(set_to_none=True)
                loss.backward()  # type: ignore[no-untyped-call]
                nn.utils.clip_grad_norm_(self.parameters, c.max_grad_norm)
                self.optimizer.step()
            if losses["kl"] > c.max_kl:
                break
        return losses

    def _loss(
        self, observations: Tensor, critic_inputs: Tensor, actions: Tensor,
        old_log_probs: Tensor, advantage: Tensor, target: Tensor, std: float,
    ) -> tuple[Tensor, dict[str, float]]:  # fmt: skip
        """Schulman et al. 2017, equations 7 and 9, with a smooth-L1 value loss."""
        c = self.config
        mean = self.actor(observations)
        z = (actions - mean) / std
        log_ratio = (-0.5 * z * z - np.log(std)).sum(-1) - old_log_probs
        ratio = log_ratio.exp()
        clipped = ratio.clamp(1 - c.clip, 1 + c.clip)
        policy_loss = -torch.minimum(ratio * advantage, clipped * advantage).mean()
        value_loss = nn.functional.smooth_l1_loss(self.critic(critic_inputs).squeeze(-1), target)
        excess = (mean.abs() - 1).clamp(min=0).square().mean()
        kl = (ratio.detach() - 1 - log_ratio.detach()).mean()
        policy_weight = float(self.progress > c.critic_warmup or c.critic_warmup == 0)
        loss = policy_weight * (policy_loss + c.mean_penalty * excess) + c.value_weight * value_loss
        return loss, {"policy": policy_loss.item(), "value": value_loss.item(), "kl": kl.item()}
