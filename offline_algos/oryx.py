"""A sequence model of the team: robots decide one after another, each told what others chose.

In the style of Oryx (Formanek et al. 2025, arXiv 2505.22151), which joins the retention network of
Sable (Mahjoub et al. 2025) with implicit constraint Q-learning (Yang et al. 2021, "Believe what you
see"), and of the multi-agent transformer (Wen et al. 2022). By the chain rule, the policy of a team
is a product over robots in an order,

    pi(a | h) = prod_i pi(a_i | h_1, ..., h_i, a_1, ..., a_i-1),

h_i what robot i observed in the episode so far. So a team that has seen two conventions does not
mix them: the first robot settles on one, the others are told. The team acts jointly, at a price:
in each step, robot i needs to hear from the robots before it. With `joint` false it does not.

pi is a `memory.sequence_networks`: retention over time and attention over the robots before. Its
answers are mixtures of Gaussians of a fixed deviation (`Mixture`), and it acts by the
likeliest mode. A value network V learns from the data's own actions; with x_{t,i} what a central
critic sees, lambda-returns (Sutton & Barto 2018, equation 12.20) within a segment, and the target
copy V' of V,

    G_t,i  = r_t,i + gamma (1 - termination) ((1 - lambda) V'(x_{t+1,i}) + lambda G_{t+1,i})
    L(V)   = E (V(x_{t,i}) - G_t,i)^2
    L(pi)  = -E w_t,i log pi(a_t,i | h_t,1, ..., h_t,i, a_t,1, ..., a_t,i-1)
    w_t,i  = exp(beta A_t,i) / Z,    A_t,i = (G_t,i - V(x_{t,i})) / sigma_A,

Z the mean over a batch, as in Yang et al. 2021, equation 9, and in Oryx's loss; A, less its mean in
the batch, is clipped to [-2, 2], and sigma_A is its deviation there, so that few rows never have
all the weight: of normal advantages, the effective sample size is exp(-beta^2) of the batch. With
beta 0 it is a clone.

Deviations from Oryx:
- Actions are continuous, so a mixture takes the place of the softmax over choices.
- A robot hears the robots before it only, in what they observed too, so that a step needs one
  message from each robot. Oryx's encoder attends to all.
- Advantages are of lambda-returns and a value network, not of a Q network with its own weights.
- The order is that of the robots' numbers. Past actions are not seen, so that a policy cannot copy
  itself; the network has one layer of each attention.
- Rewards, normalization, frames and the decay of learning rates are those of the other algorithms.

Policies do not know which robots have left an episode: those later in the order hear the action
that such a robot would take, where in training they heard zeros.
"""

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import torch
from torch import Tensor

from swarmdata.errors import SchemaError
from swarmdata.learn.memory.segments import learned_rows, take
from swarmdata.learn.memory.sequence_networks import Mixture, SequenceActor, SequenceSettings
from swarmdata.learn.networks.critics import RobotViews
from swarmdata.learn.networks.network_inputs import Normalizer, Reward, RobotRewards
from swarmdata.learn.networks.optimizer import Descent
from swarmdata.learn.networks.perceptrons import StackedMLP, mlp
from swarmdata.learn.networks.presence import agent_mean
from swarmdata.learn.networks.setup import Setup
from swarmdata.learn.objectives.losses import batch_weights, standard_advantages
from swarmdata.learn.policies.sequence_policy import SequencePolicy
from swarmdata.learn.training.actor_critic import TRANSITION, OfflineLearner, value_network
from swarmdata.learn.training.settings import Choice, LogUniform, Space
from swarmdata.types import Batch


@dataclass(frozen=True)
class OryxConfig(SequenceSettings):
    """A sequence model with advantage weights; one setting for all datasets."""

    n_updates: int = 8_000
    batch_size: int = 128  # joint transitions, in windows
    value_hidden: tuple[int, ...] = (64, 64)
    learning_rate: float = 2e-3
    value_learning_rate: float = 1e-3
    final_learning_rate_factor: float = 0.0  # at the end of the cosine; 1 keeps the rates
    discount: float = 0.95  # see `maddpg_bc`
    trace_decay: float = 0.95  # lambda
    inverse_temperature: float = 0.8  # beta; an effective sample size of a half
    tau: float = 0.01  # per update of the target
    max_grad_norm: float | None = 1.0  # per seed, of each kind of network
    reward: Reward = "own"


class Oryx(OfflineLearner):
    """K seeds of sequence models and value networks, trained at once."""

    Config = OryxConfig
    FIELDS = TRANSITION
    LOSSES = ("value_loss", "actor_loss", "v", "advantage_std", "effective_share")
    SPACE: ClassVar[Space] = {
        "learning_rate": LogUniform(3e-4, 1e-2),
        "value_learning_rate": LogUniform(3e-4, 1e-2),
        "discount": Choice((0.9, 0.95, 0.98, 0.99)),
        "trace_decay": Choice((0.0, 0.5, 0.9, 0.95)),
        "inverse_temperature": LogUniform(0.1, 3.0),
    }

    def __init__(self, setup: Setup, config: OryxConfig) -> None:
        self.config = config
        self.actor = SequenceActor(setup, config)
        self.rewards = RobotRewards(setup.statistics, config.reward)
        normalizer = Normalizer(setup.statistics, setup.device)
        self.views = RobotViews(setup.sizes, normalizer, "centralized", setup.device)
        self.value = value_network(setup, self.views.n_features, config.value_hidden)
        self.descent = Descent(
            {"actor": self.actor.network, "value": self.value}, setup.n_seeds,
            {"actor": config.learning_rate, "value": config.value_learning_rate},
            config.max_grad_norm, followed=("value",),
        )  # fmt: skip
        self.parts = (self.descent,)

    def update(self, batch: Batch) -> dict[str, Any]:
        """One step of both on windows, tensors [K, B, L, ...]; returns losses, each [K]."""
        if batch.mask.ndim < 3:
            raise SchemaError(
                f"oryx got a batch of transitions {tuple(batch.mask.shape)}, expected windows "
                "[K, B, L]: draw them with `dataset.sampler(..., horizon=config.window, "
                "burn_in=config.burn_in)`"
            )
        config, scale = self.config, self.scale
        returns = self.returns(batch)  # [K, R, N]
        now = replace(batch, rewards=None, next_states=None, next_observations=None)
        steps, outputs = self.actor.along(now)
        values = self.values(self.value, steps.states, steps.observations)
        errors = returns - values
        value_loss = agent_mean(errors.square(), self.rewards.learned(steps))
        self.descent.step_of("value", value_loss, scale)
        preferences = config.inverse_temperature * standard_advantages(errors, steps.alive)
        weights = batch_weights(preferences, steps.alive)
        mixture = Mixture.of(outputs, config.n_components)
        surprise = mixture.surprise(steps.actions, config.deviation)
        actor_loss = agent_mean(weights * surprise, steps.alive)
        self.descent.step_of("actor", actor_loss, scale)
        self.descent.follow(config.tau)
        self.n_updates += 1
        share = 1 / agent_mean(weights.square(), steps.alive)
        measured = (value_loss, actor_loss, values.mean((1, 2)), errors.std((1, 2)), share)
        named = zip(self.LOSSES, measured, strict=True)
        return {name: loss.detach() for name, loss in named}

    def values(self, network: StackedMLP, states: Tensor, observations: Tensor) -> Tensor:
        """Returns V(x_i), [K, R, N], of states [K, R, S] and observations [K, R, N, O]."""
        x = self.views.view(states, observations)
        return mlp(network.layers, x.rows).view(x.features.shape[:3])

    @torch.no_grad()
    def returns(self, batch: Batch) -> Tensor:
        """Returns G of the steps that are learned from, [K, R, N], in units of scaled rewards."""
        config, window = self.config, slice(-self.config.window, None)
        target, mask = self.descent.targets["value"], batch.mask[:, :, window]
        rewards = self.rewards(batch.rewards[:, :, window])
        states = batch.next_states[:, :, window].flatten(1, 2)
        observations = batch.next_observations[:, :, window].flatten(1, 2)
        v_next = self.values(target, states, observations)
        goes_on, alive = mask[..., None], self.rewards.learned(batch)
        if alive is not None:
            goes_on = goes_on & alive[:, :, window]
        returns = lambda_returns(
            rewards, self.rewards.ends(batch)[:, :, window], v_next.view(rewards.shape), goes_on,
            config.discount, config.trace_decay,
        )  # fmt: skip
        return take(returns, learned_rows(mask, config.window))

    def policy(self, index: int) -> SequencePolicy:
        config, actor = self.config, self.actor
        return SequencePolicy(
            layers=actor.network.extract(index, torch.float64),
            observation_mean=actor.standard.mean,
            observation_std=actor.standard.std,
            n_heads=config.n_heads,
            n_components=config.n_components,
            deviation=config.deviation,
            joint=config.joint,
            frame=actor.sizes.frame,
        )


def lambda_returns(
    rewards: Tensor,
    ends: Tensor,
    next_values: Tensor,
    mask: Tensor,
    discount: float,
    trace_decay: float,
) -> Tensor:
    """Returns G_t of the steps of windows, [K, B, L, N]; the last of a window bootstraps alone.

    Rewards, and V' of the states reached, are [K, B, L, N]; ends, and the mask, which is False on
    padding and where a robot has left, are [K, B, L, N or 1]. `trace_decay` is lambda.
    """
    goes_on = discount * (~ends)
    following, found = next_values[:, :, -1], []
    for t in range(rewards.shape[2] - 1, -1, -1):
        v = next_values[:, :, t]
        if t + 1 < rewards.shape[2]:
            is_step = mask[:, :, t + 1]
            following = torch.where(is_step, torch.lerp(v, following, trace_decay), v)
        following = rewards[:, :, t] + goes_on[:, :, t] * following
        found.append(following)
    return torch.stack(found[::-1], 2)
