"""In-sample sequential policy optimization: conventions that a team keeps without a word.

Liu et al. 2025 ("Learning generalized policies in-sample: sequential policy optimization for
offline MARL", InSPO), with the penalty of AlberDICE (Matsunaga et al. 2023). Data of teams with
two conventions hold joint actions that fit, and robots that each imitate mix them. Here each robot
improves with the data's rows weighted by how far the others, as they act now, would have acted so:

    rho_j   = pi_j(a_j | o_j) / mu_j(a_j | o_j)
    w_i     = exp(beta A_i) prod_{j != i} rho_j^kappa prod_{j != i} d_ej^kappa / Z
    L(pi_i) = -E w_i log pi_i(a_i | o_i)

mu are the policies that recorded the data, cloned in the first stage; pi begin there. If the others
lean to one convention, its rows have more weight for robot i, which then leans to it more than they
do: the team settles on one, and each robot acts by what it observes alone.

kappa = 1 is the ratio of InSPO: the rows are as if the others had acted by pi. With it, two robots
that lean alike stay as they are. AlberDICE adds alpha log(pi_-i / mu_-i) to the reward, another
factor of the ratio in the weights: kappa = 2, with which leaning grows; it grows faster with more.

d_ej stands for AlberDICE's correction of the distribution of states: how far robot j, as it acts
now, would have gone through all of recorded episode e. Conventions are chosen in a few steps, and
followed in all others, in which pi and mu agree; without d, a robot in doubt halfway would follow
either. It is the product of rho_j over an episode of H steps, by a running mean of log rho_j:

    log d_ej = H l_ej,    l_ej <- l_ej + eta (log rho_j - l_ej)    for the batch's rows of e

Policies are mixtures of Gaussians (`networks.mixtures`): a single Gaussian of two conventions lies
between them, where no robot can lean. A policy acts by its likeliest mode. The advantages are of a
value network V of the data, x_i what a central critic sees, V' its target copy:

    A_i    = (r_i + gamma (1 - termination) V'(x'_i) - V(x_i)) / sigma_A
    L(V)   = E (V(x_i) - r_i - gamma (1 - termination) V'(x'_i))^2

A is clipped to [-2, 2], sigma_A is its deviation in the batch, Z the mean of the weights in it.

Deviations:
- One network serves all robots and sees their number. In every update all of them take a small step
  by what the others do now; in the papers one robot after another is optimized to the end.
- Either product is clipped to [e^-3, e]. mu is fixed in the second stage, Z is not that of a state.
- Advantages are of one step and of the data's own values, not of the policies'. A convention is
  worth what the team gets of it much later: rewards are the team's and the discount is 0.99.
- AlberDICE learns corrections by a dual program, for each state.
- The scale of rewards, normalization, frames and the decay of learning rates are those of the
  other algorithms.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import torch
from torch import Tensor

from swarmdata.errors import SchemaError
from swarmdata.learn.networks.actor import StackedActor
from swarmdata.learn.networks.mixtures import Mixture
from swarmdata.learn.networks.network_inputs import Reward, RobotRewards
from swarmdata.learn.networks.optimizer import Descent, cosine
from swarmdata.learn.networks.perceptrons import move_target
from swarmdata.learn.networks.robot_values import RobotValues
from swarmdata.learn.networks.setup import Setup
from swarmdata.learn.objectives.losses import batch_weights, standard_advantages, td_target
from swarmdata.learn.policies.mixture_policy import MixturePolicy
from swarmdata.learn.training.actor_critic import TRANSITION, OfflineLearner, Part
from swarmdata.types import Batch

LOG_RATIO_RANGE = (-3.0, 1.0)
"""Of kappa times the sum of log rho, and of that of log d: what the others would not do counts
little; what they would do, hardly more than rows in which they have no choice."""


@dataclass(frozen=True)
class InSPOConfig:
    """Clones that settle on one convention; one setting for all datasets.

    Raises:
        SchemaError: the share of the second stage is not between 0 and 1.
    """

    n_updates: int = 10_000
    batch_size: int = 256  # joint transitions
    hidden: tuple[int, ...] = (128, 128)
    n_components: int = 4  # modes of a robot's action
    deviation: float = 0.1  # of each mode; what is nearer than twice that is one mode
    settling_share: float = 0.6  # of the updates, the last ones: the second stage
    ratio_exponent: float = 4.0  # kappa
    episode_steps: int = 50  # H
    episode_rate: float = 0.03  # eta
    inverse_temperature: float = 0.8  # beta
    value_hidden: tuple[int, ...] = (64, 64)
    learning_rate: float = 3e-3  # see `bc`
    value_learning_rate: float = 1e-3  # as of the critics of others
    final_learning_rate_factor: float = 0.0  # at the end of the cosine of each stage
    discount: float = 0.99  # see above
    tau: float = 0.01  # per update of the target
    max_grad_norm: float | None = 10.0  # per seed, of each kind of network
    reward: Reward = "team"

    def __post_init__(self) -> None:
        """Checks the share."""
        if not 0 < self.settling_share < 1:
            raise SchemaError(
                f"settling_share is {self.settling_share}, expected above 0 and below 1"
            )


class InSPO(OfflineLearner):
    """K seeds of actors, of clones and of value networks, trained at once.

    Raises:
        SchemaError: the number of episodes of the data is not known.
    """

    Config = InSPOConfig
    FIELDS = (*TRANSITION, "episodes")
    LOSSES = ("value_loss", "actor_loss", "advantage_std", "log_ratio", "effective_share")

    def __init__(self, setup: Setup, config: InSPOConfig) -> None:
        self.config, self.sizes = config, setup.sizes
        if setup.n_episodes < 1:
            raise SchemaError(
                f"inspo got {setup.n_episodes} episodes, expected their number: each has a weight. "
                "Give it as Setup.n_episodes."
            )
        self.leanings = Leanings(setup)
        n_outputs = config.n_components * (1 + setup.sizes.action)
        self.actor = StackedActor(
            replace(setup.sizes, action=n_outputs), setup.seeds, config.hidden, setup.statistics,
            squash=False, device=setup.device,
        )  # fmt: skip
        self.values = RobotValues(setup, config.value_hidden)
        self.rewards = RobotRewards(setup.statistics, config.reward)
        self.descent = Descent(
            {"actor": self.actor.network, "value": self.values.network}, setup.n_seeds,
            {"actor": config.learning_rate, "value": config.value_learning_rate},
            config.max_grad_norm, followed=("actor", "value"),
        )  # fmt: skip
        self.clones = self.descent.targets["actor"]  # mu, in the second stage
        self.settling_from = config.n_updates - round(config.n_updates * config.settling_share)

    @property
    def parts(self) -> tuple[Part, ...]:
        return self.descent, self.leanings

    @property
    def scale(self) -> float:
        """The factor on learning rates now: a cosine over each stage."""
        config, first, floor = (
            self.config,
            self.settling_from,
            self.config.final_learning_rate_factor,
        )
        if self.n_updates < first:
            return cosine(self.n_updates, first, floor)
        return cosine(self.n_updates - first, config.n_updates - first, floor)

    def update(self, batch: Batch) -> dict[str, Any]:
        """One step on tensors [K, B, ...]; returns losses, each [K]."""
        config, scale, first = self.config, self.scale, self.settling_from
        if self.n_updates == first:
            move_target(self.clones, self.actor.network, 1.0)
        advantages = self.advantages(batch)  # [K, B, N]
        value_loss = advantages.square().mean((1, 2))
        self.descent.step_of("value", value_loss, scale)
        move_target(self.descent.targets["value"], self.values.network, config.tau)
        surprise = self.surprise(batch, self.actor.network)  # -log pi(a_i | o_i), [K, B, N]
        exponents = torch.zeros_like(surprise)
        ratios = torch.zeros_like(surprise)
        if self.n_updates >= first:
            with torch.no_grad():
                ratios = self.surprise(batch, self.clones) - surprise  # log rho, [K, B, N]
            self.leanings.learn(batch.episodes, ratios, config.episode_rate)
            episodes = config.episode_steps * self.leanings.of(batch.episodes)  # log d
            exponents = sum(
                (config.ratio_exponent * of_others(each)).clamp(*LOG_RATIO_RANGE)
                for each in (ratios, episodes)
            )
            exponents += config.inverse_temperature * standard_advantages(advantages)
        weights = batch_weights(exponents)
        actor_loss = (weights * surprise).mean((1, 2)) * self._unit
        self.descent.step_of("actor", actor_loss, scale)
        self.n_updates += 1
        share = 1 / weights.square().mean((1, 2))
        measured = (value_loss, actor_loss, advantages.std((1, 2)), ratios.mean((1, 2)), share)
        named = zip(self.LOSSES, measured, strict=True)
        return {name: loss.detach() for name, loss in named}

    def advantages(self, batch: Batch) -> Tensor:
        """Returns r + gamma (1 - termination) V'(x') - V(x), [K, B, N], in scaled rewards."""
        target = self.descent.targets["value"]
        with torch.no_grad():
            v_next = self.values(batch.next_states, batch.next_observations, target)
        ends = batch.terminations[..., None]
        y = td_target(self.rewards(batch.rewards), ends, v_next, self.config.discount)
        return y - self.values(batch.states, batch.observations)

    def surprise(self, batch: Batch, network: Any) -> Tensor:
        """Returns -log pi(a_i | o_i), but for a constant, [K, B, N]."""
        config = self.config
        mixture = Mixture.of(self.actor(batch.observations, network), config.n_components)
        return mixture.surprise(batch.actions, config.deviation) / self._unit

    @property
    def _unit(self) -> float:
        """That turns nats into squared errors: what a `Mixture` measures surprise in."""
        return 2 * self.config.deviation**2 / self.sizes.action

    def policy(self, index: int) -> MixturePolicy:
        """The policy of seed number `index`, as it is now."""
        return MixturePolicy(
            layers=self.actor.network.extract(index, torch.float64),
            observation_mean=self.actor.standard.mean,
            observation_std=self.actor.standard.std,
            n_components=self.config.n_components,
            deviation=self.config.deviation,
            frame=self.sizes.frame,
        )


class Leanings:
    """How far robots would have gone through each recorded episode, l, [K, M, N]."""

    def __init__(self, setup: Setup) -> None:
        shape = (setup.n_seeds, setup.n_episodes, setup.sizes.n_agents)
        self.values = torch.zeros(shape, device=setup.device)

    def of(self, episodes: Tensor) -> Tensor:
        """Returns l of the episodes of rows [K, B], [K, B, N]."""
        return self.values.gather(1, self._index(episodes))

    def learn(self, episodes: Tensor, ratios: Tensor, rate: float) -> None:
        """Moves l of the episodes of rows [K, B] by `rate` of the way to their ratios [K, B, N]."""
        moves = rate * (ratios.detach() - self.of(episodes))
        self.values.scatter_add_(1, self._index(episodes), moves)

    def _index(self, episodes: Tensor) -> Tensor:
        return episodes[..., None].expand(*episodes.shape, self.values.shape[2])

    def state_dict(self) -> dict[str, Tensor]:
        """The leanings, as a copy."""
        return {"leanings": self.values.clone()}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Restores what `state_dict` returned; other entries are left alone."""
        self.values.copy_(state["leanings"])


def of_others(values: Tensor) -> Tensor:
    """Returns the sum over the other robots, [K, B, N], of values [K, B, N]."""
    return values.sum(2, keepdim=True) - values
