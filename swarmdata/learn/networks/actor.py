"""The deterministic policies of K seeds, each shared by all agents, and their slow copies."""

from collections.abc import Mapping, Sequence
from typing import Any, Literal

import torch
from torch import Tensor

from swarmdata.learn.networks.network_inputs import Standardization, with_agent_id
from swarmdata.learn.networks.optimizer import StackedAdam
from swarmdata.learn.networks.perceptrons import MLPShape, StackedMLP, initialize
from swarmdata.learn.networks.set_networks import SetShape, StackedSets
from swarmdata.learn.networks.sizes import Sizes
from swarmdata.learn.objectives.td_targets import move_target
from swarmdata.learn.policies.set_policy import SetPolicy
from swarmdata.learn.policies.torch_policy import TorchPolicy
from swarmdata.learn.training.checkpoint import part
from swarmdata.learn.training.dataset_statistics import Statistics
from swarmdata.learn.training.exploration import normal_like
from swarmdata.perception.feature_slots import slots_of
from swarmdata.types import Batch

ACTOR_STREAM, CRITIC_STREAM = 0, 1
"""Streams of a seed's initial parameters."""


PolicyNetwork = Literal["mlp", "deep_sets"]
"""A perceptron of the whole observation and the robot's number, or a network over sets."""


class StackedActor:
    """Maps normalized observations to actions; perceptrons see the agent's number too.

    Args:
        sizes: numbers of agents and features.
        seeds: of the initial parameters, [K].
        hidden: sizes of the hidden layers.
        statistics: of the dataset, to normalize observations.
        squash: whether outputs pass through tanh; otherwise they are clipped when acting only.
        device: where the parameters are.
        policy_network: `deep_sets` reads the slots of an observation as sets (`set_networks`).

    Raises:
        SchemaError: features have no names, which `deep_sets` needs.
    """

    def __init__(
        self,
        sizes: Sizes,
        seeds: Sequence[int],
        hidden: tuple[int, ...],
        statistics: Statistics,
        *,
        squash: bool,
        device: torch.device | str,
        policy_network: PolicyNetwork = "mlp",
    ) -> None:
        self.network: StackedMLP | StackedSets
        mean, std = statistics.observation_mean, statistics.observation_std
        if policy_network == "deep_sets":
            slots = slots_of(sizes.features, sizes.frame)
            self._field_moments = slots.moments(mean, std)
            mean, std = slots.normalizing(*self._field_moments)
            self.network = StackedSets(SetShape(slots, hidden, sizes.action), len(seeds), device)
        else:
            shape = MLPShape(sizes.observation + sizes.n_agents, hidden, sizes.action)
            self.network = StackedMLP(shape, len(seeds), device)
        initialize(self.network, seeds, ACTOR_STREAM)
        self.squash, self._frame, self._features = squash, sizes.frame, sizes.features
        self._standard = Standardization(mean, std, device)

    def inputs(self, observations: Tensor) -> Tensor:
        """Returns the network's input rows of observations [K, B, N, O].

        Those of a perceptron are [K, B N, O + N], those of a network over sets [K, B N, O].
        """
        standard = self._standard(observations)
        is_numbered = isinstance(self.network, StackedMLP)
        return (with_agent_id(standard) if is_numbered else standard).flatten(1, 2)

    def __call__(
        self, observations: Tensor, network: StackedMLP | StackedSets | None = None
    ) -> Tensor:
        """Returns actions, [K, B, N, A], of observations [K, B, N, O].

        Args:
            observations: as recorded.
            network: other parameters to use, such as those of the target policy.
        """
        outputs = (network or self.network)(self.inputs(observations))
        actions = outputs.tanh() if self.squash else outputs
        return actions.view(*observations.shape[:3], -1)

    def along(self, batch: Batch) -> tuple[Batch, Tensor]:
        """Returns a batch of transitions, and the actions there, [K, B, N, A]."""
        return batch, self(batch.observations)

    def policy(self, index: int) -> TorchPolicy | SetPolicy:
        """Returns the policy of seed number `index`, a copy of its parameters as they are now."""
        if isinstance(self.network, StackedSets):
            return self._set_policy(index, self.network.shape)
        return TorchPolicy(
            layers=self.network.extract(index, torch.float64),
            observation_mean=self._standard.mean,
            observation_std=self._standard.std,
            squash=self.squash,
            frame=self._frame,
        )

    def _set_policy(self, index: int, shape: SetShape) -> SetPolicy:
        mean, std = self._field_moments
        return SetPolicy(
            layers=self.network.extract(index, torch.float64),
            field_mean=torch.from_numpy(mean),
            field_std=torch.from_numpy(std),
            squash=self.squash,
            slots=shape.slots,
            hidden=shape.hidden,
            frame=self._frame,
            anchor="world" if self._frame is None else self._frame.anchor_of(self._features),
        )


class DelayedActor:
    """Squashed policies of K seeds, their slow copies for targets, and their optimizer.

    Attributes:
        online: the policies that are trained.
        target: parameters of their slow copies.

    Args:
        online: the policies; their outputs pass through tanh.
        n_seeds: number of seeds, K.
        learning_rate: of Adam.
        max_norm: largest norm of one seed's gradient; None does not clip.
    """

    def __init__(
        self,
        online: StackedActor,
        n_seeds: int,
        *,
        learning_rate: float,
        max_norm: float | None,
    ) -> None:
        self.online, self.target = online, online.network.clone()
        self.optimizer = StackedAdam(online.network, n_seeds, learning_rate, max_norm)

    def __call__(self, observations: Tensor) -> Tensor:
        """Returns actions, [K, B, N, A], of observations [K, B, N, O] as recorded."""
        return self.online(observations)

    def smoothed(
        self,
        observations: Tensor,
        generators: Sequence[torch.Generator],
        deviation: float,
        largest: float,
    ) -> Tensor:
        """Returns the slow copies' actions with clipped noise, [K, B, N, A], in [-1, 1].

        Target policy smoothing (Fujimoto et al. 2018, eq. 14).

        Args:
            observations: as recorded, [K, B, N, O].
            generators: of the noise, one per seed, [K].
            deviation: of the Gaussian noise before it is clipped.
            largest: noise is clipped to [-largest, largest].
        """
        size = self.target.shape.outputs
        shape = observations[..., :1].expand(*observations.shape[:-1], size)
        return self.smoothed_by(normal_like(generators, shape), observations, deviation, largest)

    def smoothed_by(
        self, noise: Tensor, observations: Tensor, deviation: float, largest: float
    ) -> Tensor:
        """As `smoothed`, a pure function: the noise was drawn before.

        Args:
            noise: standard normal, [K, B, N, A].
            observations: as recorded, [K, B, N, O].
            deviation: factor on the noise before it is clipped.
            largest: noise is clipped to [-largest, largest].
        """
        actions = self.online(observations, self.target)
        return (actions + (noise * deviation).clamp(-largest, largest)).clamp(-1, 1)

    def step(self, loss: Tensor, scale: float = 1.0) -> None:
        """Moves the policies down the sum over seeds of a loss [K].

        Args:
            loss: one value per seed.
            scale: factor on the learning rate.
        """
        self.optimizer.step(loss, scale)

    def follow(self, rate: float) -> None:
        """Moves the slow copies by `rate` of the way to the policies (Polyak averaging)."""
        move_target(self.target, self.online.network, rate)

    def policy(self, index: int) -> TorchPolicy | SetPolicy:
        """Returns the policy of seed number `index`, as it is now."""
        return self.online.policy(index)

    def state_dict(self) -> dict[str, Tensor]:
        """Parameters, slow copies and Adam's moments, as copies."""
        return {
            "actor": self.online.network.flat.clone(),
            "target_actor": self.target.flat.clone(),
            **{f"actor_adam.{k}": v for k, v in self.optimizer.state_dict().items()},
        }

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Restores what `state_dict` returned; other entries are left alone."""
        self.online.network.load(state["actor"])
        self.target.load(state["target_actor"])
        self.optimizer.load_state_dict(part(state, "actor_adam"))
