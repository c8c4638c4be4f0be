"""JointActorCritic: the parts that actor-critics of teams share; no losses."""

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import torch
from torch import Tensor

from swarmdata.learn.networks.actor import DelayedActor
from swarmdata.learn.networks.critics import JointCritics
from swarmdata.learn.networks.network_inputs import (
    generator_states,
    generators,
    information,
    restore_generators,
)
from swarmdata.learn.networks.normalizer import Normalizer
from swarmdata.learn.networks.sizes import Sizes
from swarmdata.learn.objectives.td_targets import td_target, team_reward
from swarmdata.learn.policies.torch_policy import TorchPolicy
from swarmdata.learn.training.dataset_statistics import Statistics
from swarmdata.types import Batch


class Settings(Protocol):
    """The part of an algorithm's config that its networks and targets need."""

    @property
    def actor_hidden(self) -> tuple[int, ...]: ...
    @property
    def critic_hidden(self) -> tuple[int, ...]: ...
    @property
    def step_size(self) -> float: ...
    @property
    def critic_step_size(self) -> float: ...
    @property
    def max_gradient_norm(self) -> float | None: ...
    @property
    def discount(self) -> float: ...
    @property
    def polyak(self) -> float: ...
    @property
    def noise(self) -> float: ...  # deviation of target smoothing
    @property
    def noise_clip(self) -> float: ...
    @property
    def clip_target(self) -> bool: ...


class JointActorCritic:
    """Actors, twin joint critics, noise and normalization of K seeds.

    Attributes:
        actor: policies and their slow copies.
        critics: twins and their slow copies.
        generators: of all noise, one per seed, [K].
        reward_scale: 1 / standard deviation of the returns-to-go.
        max_value: R*, the largest return-to-go, in scaled rewards.

    Args:
        sizes: numbers of agents and features.
        seeds: of initial parameters and noise, [K].
        config: settings.
        statistics: of the dataset.
        device: where to train.
    """

    def __init__(
        self,
        sizes: Sizes,
        seeds: Sequence[int],
        config: Settings,
        statistics: Statistics,
        device: torch.device | str,
    ) -> None:
        self.config, norm = config, config.max_gradient_norm
        self.actor = DelayedActor(
            sizes, seeds, config.actor_hidden, statistics,
            step_size=config.step_size, max_norm=norm, device=device,
        )  # fmt: skip
        self.critics = JointCritics(
            sizes, seeds, config.critic_hidden,
            step_size=config.critic_step_size, max_norm=norm, device=device,
        )  # fmt: skip
        self.generators = generators(seeds, device)
        self.normalizer = Normalizer(statistics, device)
        self.reward_scale = 1 / statistics.return_std
        self.max_value = statistics.max_return * self.reward_scale

    def information(self, states: Tensor, observations: Tensor) -> Tensor:
        """Returns x, [K, B, S + N O], of states [K, B, S] and observations [K, B, N, O]."""
        known = self.normalizer
        return information(known.states(states), known.observations(observations))

    def next_policy_actions(self, batch: Batch) -> Tensor:
        """Returns pi'(o') + clip(noise, -c, c), [K, B, N, A]; draws the noise."""
        config = self.config
        return self.actor.smoothed(
            batch.next_observations, self.generators, config.noise, config.noise_clip
        )

    def bootstrapped(self, batch: Batch, a_next: Tensor) -> Tensor:
        """Returns y = r + gamma (1 - termination) min(min_j Q'_j(x', a'), R*), [K, B].

        Args:
            batch: tensors [K, B, ...].
            a_next: actions of the next step, [K, B, N, A].
        """
        x_next = self.information(batch.next_states, batch.next_observations)
        q_next = self.critics.target_q(x_next, a_next)[..., 0].amin(1)  # [K, B]
        if self.config.clip_target:
            q_next = q_next.clamp(max=self.max_value)
        r = team_reward(batch.rewards) * self.reward_scale
        return td_target(r, batch.terminations, q_next, self.config.discount)

    def follow(self) -> None:
        """Moves the slow copies of actors and critics."""
        self.actor.follow(self.config.polyak)
        self.critics.follow(self.config.polyak)

    def policy(self, index: int) -> TorchPolicy:
        """Returns the policy of seed number `index`, as it is now."""
        return self.actor.policy(index)

    def state_dict(self) -> dict[str, Tensor]:
        """Parameters, slow copies, Adam's moments and generators, as copies."""
        return {
            "generators": generator_states(self.generators),
            **self.actor.state_dict(),
            **self.critics.state_dict(),
        }

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Restores what `state_dict` returned; other entries are left alone."""
        restore_generators(self.generators, state["generators"])
        self.actor.load_state_dict(state)
        self.critics.load_state_dict(state)


def imitation(pi: Tensor, actions: Tensor) -> Tensor:
    """Returns sum_i 1/A |pi(o_i, i) - a_i|^2, the mean over rows, [K].

    Args:
        pi: actions of the policies, [K, B, N, A].
        actions: of the data, [K, B, N, A].
    """
    return (pi - actions).square().sum(2).mean((1, 2))
