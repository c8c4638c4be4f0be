"""VDN: the team's value is the mean of its robots' values, which see what the robots see.

Sunehag et al., "Value-decomposition networks for cooperative multi-agent learning", AAMAS 2018,
section 3, over choices among bins of each action dimension (`learn.choices.bins`), trained by
double Q-learning (van Hasselt et al. 2016, equation 4):

    Q_tot(o, u) = 1/N sum_i Q_i(o_i, u_i)      Q_i(o_i, u_i) = 1/D sum_d U_d(o_i, u_id)
    u'_i  = argmax_u Q_i(o'_i, u)                          chosen by the online networks
    y     = r + gamma (1 - termination) Q'_tot(o', u')     valued by the targets
    L     = Huber(Q_tot(o, u) - y)

A training that starts from an offline run has its utility networks, two for each seed with
LayerNorm, and its mixer if it fits.

Deviations:
- The mean over robots instead of the sum: the team reward is a mean too, so that values keep their
  scale in teams of any size. The greedy choices are the same.
- Feed-forward networks, no recurrent ones: observations hold velocities.
- Single transitions from many copies instead of whole episodes; slowly moving targets instead of
  hard copies; Huber loss; actions and observations turned to the robot's target (`frame`).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from swarmdata.errors import CheckpointError
from swarmdata.learn.choices import bins
from swarmdata.learn.networks.network_inputs import information
from swarmdata.learn.networks.optimizer import Descent
from swarmdata.learn.networks.perceptrons import MLPShape, StackedMLP
from swarmdata.learn.networks.setup import Sizes
from swarmdata.learn.networks.team_networks import Team
from swarmdata.learn.objectives.losses import huber_error, td_target, team_reward
from swarmdata.learn.policies.choice_policy import BinPolicy, ChoicePolicy
from swarmdata.online_algos.collection.replay_collection import (
    OffPolicy,
    ReplaySettings,
    epsilon_greedy,
)
from swarmdata.online_algos.continuation.offline_start import (
    OfflineStart,
    as_text,
    check_fit,
    frame_name,
    hidden_sizes,
)
from swarmdata.specs.features import Feature
from swarmdata.types import Batch

UTILITY_STREAM, MIXER_STREAM = 0, 1
"""Streams of a seed's initial parameters."""


@dataclass(frozen=True)
class VDNConfig(ReplaySettings):
    """Settings of VDN."""

    n_bins: int = 9  # of each action dimension; odd, so that standing still is one
    hidden: tuple[int, ...] = (64, 64)
    n_critics: int = 1  # utility networks of a seed, J, whose mean chooses
    layer_norm: bool = False  # in the utility networks
    learning_rate: float = 1e-3
    tau: float = 0.01  # per gradient step
    epsilon: float = 1.0
    final_epsilon: float = 0.05
    exploration: float = 0.3  # part of training in which epsilon falls


class VDNLearner:
    """K seeds of utility networks, trained on batches of bins, and perhaps of a mixer's networks.

    `sizes.action` is the number of choices that a robot makes. A discrete action space is the case
    of 1: then there are `n_bins` actions to choose from.
    """

    def __init__(
        self, sizes: Sizes, seeds: Sequence[int], config: VDNConfig, mixer: StackedMLP | None = None
    ) -> None:
        self.config = config
        n_outputs = sizes.action * config.n_bins
        self.team = Team(
            MLPShape(sizes.observation, config.hidden, n_outputs, config.layer_norm),
            sizes.n_agents, seeds, UTILITY_STREAM,
            parameters=config.parameters, device="cpu", n_critics=config.n_critics,
        )  # fmt: skip
        networks = {"team": self.team.network} | ({} if mixer is None else {"mixer": mixer})
        self.descent = Descent(
            networks, len(seeds), config.learning_rate, config.max_grad_norm, followed=networks
        )
        self.state_dict = self.descent.state_dict
        self.load_state_dict = self.descent.load_state_dict

    def utilities(self, features: Tensor, network: StackedMLP | None = None) -> Tensor:
        """Returns the utility of every bin, [K, J, B, N, D, C], of normalized [K, B, N, F]."""
        n_critics = self.config.n_critics
        outputs = self.team(features.repeat_interleave(n_critics, 0), network)
        utilities = bins.by_dimension(outputs, self.config.n_bins)
        return utilities.view(-1, n_critics, *utilities.shape[1:])

    def value(self, features: Tensor, states: Tensor, places: Tensor) -> Tensor:
        """Returns Q_tot of each critic, [K, J, B], of `bins.places`, [K, B, N, D].

        Features and states, [K, B, N, O] and [K, B, S], are normalized.
        """
        utilities = self.utilities(features)
        values = bins.interpolated(utilities, by_critic(places, utilities))  # [K, J, B, N]
        return self.mix(values, information(states, features))

    def mix(self, values: Tensor, x: Tensor, network: StackedMLP | None = None) -> Tensor:
        """Returns Q_tot, [K, J, B], of robots' [K, J, B, N] and x [K, B, X], unused by a mean."""
        return values.mean(-1)

    @torch.no_grad()
    def targets(self, batch: Batch) -> Tensor:
        """Returns y, [K, B], in units of scaled rewards."""
        o_next, slow = batch.next_observations, self.descent.targets
        choices = greedy_choices(self.utilities(o_next))
        utilities = self.utilities(o_next, slow["team"])
        values = bins.chosen(utilities, by_critic(choices, utilities))  # [K, J, B, N]
        x_next = information(batch.next_states, o_next)
        q_next = self.mix(values, x_next, slow.get("mixer")).mean(1)  # [K, B]
        r = team_reward(batch.rewards) * self.config.reward_scale
        return td_target(r, batch.terminations, q_next, self.config.discount)

    def update(self, batch: Batch, scale: float = 1.0) -> dict[str, Tensor]:
        """One step on tensors [K, B, ...] down Huber(Q_tot - y); returns losses, each [K].

        Observations and states are normalized, actions places among bins.
        """
        y = self.targets(batch)
        q = self.value(batch.observations, batch.states, batch.actions)  # [K, J, B]
        td_loss = huber_error(q, y)  # [K]
        self.descent.step(td_loss, scale)
        self.descent.follow(self.config.tau)
        return {"td_loss": td_loss.detach(), "q": q.detach().mean((1, 2)), "target": y.mean(1)}


def by_critic(values: Tensor, utilities: Tensor) -> Tensor:
    """Returns values [K, B, N, D] once for each critic of utilities, [K, J, B, N, D]."""
    return values[:, None].expand(*utilities.shape[:-1])


def greedy_choices(utilities: Tensor) -> Tensor:
    """Returns the best bins, [K, B, N, D], of utilities [K, J, B, N, D, C]."""
    return utilities.mean(1).argmax(-1)


WHEN_STARTED = {"epsilon": "0.1"}
"""Settings of a training that starts from an offline run, where the user gives no others: random
choices would hide what the policies can do."""


class VDN(OffPolicy):
    """K seeds in K E copies of a task, with their replay in a folder."""

    Config: type[VDNConfig] = VDNConfig
    Learner: type[VDNLearner] = VDNLearner
    LOSSES = ("td_loss", "q", "target", "reward")

    def new_learner(self) -> VDNLearner:
        return self.Learner(self.worlds.sizes, self.seeds, self.config)

    def stored(self, actions: Tensor) -> Tensor:
        """Returns places among bins: recorded actions lie between two."""
        return bins.places(actions, self.config.n_bins)

    @staticmethod
    def settings_of(start: OfflineStart, features: Sequence[Feature]) -> dict[str, str]:
        """Returns the settings of the run's networks and values, and `WHEN_STARTED`."""
        policy = _started_policy(start, start.run.seeds[0])
        n_rows = 1 if policy.parameters == "shared" else start.run.n_agents
        return {
            "hidden": as_text(hidden_sizes(policy.layers)),
            "n_critics": str(len(policy.layers[0].weight) // n_rows),
            "layer_norm": str(policy.layers[0].scale is not None).lower(),
            "parameters": policy.parameters,
            "n_bins": str(policy.choices.n_choices),
            "frame": frame_name(policy.frame, features),
            "discount": str(start.discount),
            "reward_scale": str(start.reward_scale),
            **WHEN_STARTED,
        }

    def start_from(self, start: OfflineStart) -> list[str]:
        """Takes over utility networks, their inputs' statistics, and a mixer that fits."""
        team, descent = self.learner.team, self.learner.descent
        policies = [_started_policy(start, seed) for seed in self.seeds]
        check_fit(start, "utility networks", self.policy(0), policies[0])
        n_rows = len(policies[0].layers[0].weight)
        for k, policy in enumerate(policies):
            team.network.load_layers(slice(k * n_rows, (k + 1) * n_rows), policy.layers)
        descent.targets["team"].load(team.network.flat)
        self.moments = start.moments(len(self.seeds))
        sentences = []
        if start.has_other_rewards:
            sentences.append(
                f"The values of {start.name} are of other weights of rewards than the task's, with "
                "which training goes on."
            )
        if "mixer" in descent.networks and not _start_mixer(start, descent, self.seeds):
            sentences.append(f"The mixer begins anew: {start.name} has none of the same sizes.")
        return sentences

    def explore(self, observations: Tensor) -> tuple[Tensor, Tensor]:
        """Returns actions and their bins, [K, E, N, D], chosen epsilon-greedily."""
        c, n_bins = self.config, self.config.n_bins
        epsilon = self.faded(c.epsilon, c.final_epsilon)
        best = greedy_choices(self.learner.utilities(observations))
        chosen = epsilon_greedy(self.acting, best, n_bins, epsilon)
        return bins.to_actions(chosen, n_bins), chosen.float()

    def learn(self, batch: Batch, scale: float) -> dict[str, Tensor]:
        return self.learner.update(self.normalized(batch), scale)

    def policy(self, index: int) -> BinPolicy:
        config, (mean, std) = self.config, self.inputs_of(index)
        return BinPolicy(
            layers=self.learner.team.extract(index, config.n_critics),
            observation_mean=mean,
            observation_std=std,
            n_bins=config.n_bins,
            frame=self.frame,
            parameters=config.parameters,
            n_critics=config.n_critics,
        )


def _started_policy(start: OfflineStart, seed: int) -> ChoicePolicy:
    """The policy of a seed of an offline run, if it acts by the utilities of bins alone.

    Those with a behavior head (`--regulariser bc` and `bcq`) act by it too.
    """
    policy = start.policy(seed)
    if not isinstance(policy, ChoicePolicy) or policy.behavior or policy.ranges:
        raise CheckpointError(
            f"{start.name} holds policies of {start.run.algorithm} that do not act by the "
            "utilities of bins alone. Start from a run of offline vdn or qmix on continuous "
            "actions with --regulariser none or cql."
        )
    return policy


def _start_mixer(start: OfflineStart, descent: Descent, seeds: Sequence[int]) -> bool:
    """Copies the mixers of the run; returns False if they do not fit."""
    mine = descent.networks["mixer"]
    theirs = getattr(getattr(start.algorithm, "mixer", None), "network", None)
    if start.is_compact or not isinstance(theirs, StackedMLP) or theirs.shape != mine.shape:
        return False
    per_seed = len(mine.flat) // len(seeds)
    for k, seed in enumerate(seeds):
        first = per_seed * start.index(seed)
        mine.flat[k * per_seed : (k + 1) * per_seed] = theirs.flat[first : first + per_seed]
    descent.targets["mixer"].load(mine.flat)
    return True
