"""Critics: the values of joint actions that K seeds learn, with slowly moving targets.

A critic is a network of x = (state, all observations) and the actions of all agents (Lowe et al.
2017, eq. 6). Each seed has J of them, usually two (Fujimoto et al. 2018, section 4.2), which begin
with parameters of their own.
"""

from collections.abc import Mapping, Sequence
from typing import Any, Literal, Required, TypedDict, Unpack

import torch
from torch import Tensor

from swarmdata.learn.networks.actor import CRITIC_STREAM
from swarmdata.learn.networks.optimizer import StackedAdam
from swarmdata.learn.networks.perceptrons import MLPShape, StackedMLP, initialize, mlp_of_branches
from swarmdata.learn.networks.sizes import Sizes
from swarmdata.learn.objectives.td_targets import move_target
from swarmdata.learn.training.checkpoint import part

JointGradient = Literal["all", "own"]
"""Whose actions the policy gives in its own loss: those of all agents, or of one at a time."""


class CriticOptions(TypedDict, total=False):
    """What `Critics` are told by keyword."""

    learning_rate: Required[float]
    max_norm: Required[float | None]
    n_critics: int
    n_values: int
    device: torch.device | str


class Critics:
    """J critics of each of K seeds, their targets, and their optimizer.

    Attributes:
        online: the critics; rows are seed 0 critic 0, seed 0 critic 1, ..., seed 1 critic 0, ...
        target: their slow copies.

    Args:
        n_inputs: features that a critic sees, actions included.
        seeds: of the initial parameters, [K].
        hidden: sizes of the hidden layers, which have LayerNorm.
        learning_rate: of Adam.
        max_norm: largest norm of the gradient of one seed's critics; None does not clip.
        n_critics: critics of a seed, J.
        n_values: outputs of a critic, V: 1 for the team's value, N for one per agent's reward.
        device: where to train.
    """

    def __init__(
        self,
        n_inputs: int,
        seeds: Sequence[int],
        hidden: tuple[int, ...],
        *,
        learning_rate: float,
        max_norm: float | None,
        n_critics: int = 2,
        n_values: int = 1,
        device: torch.device | str = "cpu",
    ) -> None:
        self.n_critics = n_critics
        shape = MLPShape(n_inputs, hidden, n_values, layer_norm=True)
        self.online = StackedMLP(shape, n_critics * len(seeds), device)
        initialize(self.online, seeds, CRITIC_STREAM)
        self.target = self.online.clone()
        self.optimizer = StackedAdam(self.online, len(seeds), learning_rate, max_norm)

    def q(self, x: Tensor, actions: Tensor) -> Tensor:
        """Returns all critics' values, [K, J, B, V].

        Args:
            x: critic inputs besides actions, `information`, [K, B, S + N O].
            actions: joint actions, [K, B, N, A].
        """
        return self._values(self.online, x, actions)

    def target_q(self, x: Tensor, actions: Tensor) -> Tensor:
        """Returns the values that the slow copies give, as `q`."""
        return self._values(self.target, x, actions)

    def _values(self, network: StackedMLP, x: Tensor, actions: Tensor) -> Tensor:
        inputs = torch.cat([x, actions.flatten(2)], 2)
        values = network(inputs.repeat_interleave(self.n_critics, 0))
        return values.view(-1, self.n_critics, *values.shape[1:])

    def sampled_q(self, x: Tensor, actions: Tensor) -> Tensor:
        """Returns all critics' values of M joint actions in each row, [K, J, B, M, V].

        Args:
            x: critic inputs besides actions, [K, B, S + N O].
            actions: [K, B, M, N, A].
        """
        shared, varied = (t.repeat_interleave(self.n_critics, 0) for t in (x, actions.flatten(3)))
        values = mlp_of_branches(self.online.layers, shared, varied)
        return values.view(-1, self.n_critics, *values.shape[1:])

    def first_q(self, x: Tensor, actions: Tensor) -> Tensor:
        """Returns the first critics' values, [K, B, V], with the critics' parameters as constants.

        Args:
            x: critic inputs besides actions, [K, B, S + N O].
            actions: joint actions, [K, B, N, A].
        """
        joint = torch.cat([x, actions.flatten(2)], 2)
        return self.online.frozen(joint, every=self.n_critics)

    def first_sampled_q(self, x: Tensor, actions: Tensor) -> Tensor:
        """Returns the first critics' values of M joint actions in each row, [K, B, M, V].

        The critics' parameters are constants, as in `first_q`; arguments as in `sampled_q`.
        """
        return mlp_of_branches(self.online.constants(self.n_critics), x, actions.flatten(3))

    def smallest_q(self, x: Tensor, varied: Tensor) -> Tensor:
        """Returns the smallest of the J values of M actions in each row, [K, B, M]; constants.

        Args:
            x: critic inputs besides actions, [K, B, F].
            varied: actions as critics see them, [K, B, M, D].
        """
        shared, branches = (t.repeat_interleave(self.n_critics, 0) for t in (x, varied))
        values = mlp_of_branches(self.online.constants(), shared, branches)[..., 0]
        return values.view(-1, self.n_critics, *values.shape[1:]).amin(1)

    def step(self, loss: Tensor, scale: float = 1.0) -> None:
        """Moves the critics down the sum over seeds of a loss [K].

        Args:
            loss: one value per seed.
            scale: factor on the learning rate.
        """
        self.optimizer.step(loss, scale)

    def follow(self, rate: float) -> None:
        """Moves the slow copies by `rate` of the way to the critics (Polyak averaging)."""
        move_target(self.target, self.online, rate)

    def state_dict(self) -> dict[str, Tensor]:
        """Parameters, targets and Adam's moments, as copies."""
        return {
            "critics": self.online.flat.clone(),
            "target_critics": self.target.flat.clone(),
            **{f"critic_adam.{k}": v for k, v in self.optimizer.state_dict().items()},
        }

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Restores what `state_dict` returned; other entries are left alone."""
        self.online.load(state["critics"])
        self.target.load(state["target_critics"])
        self.optimizer.load_state_dict(part(state, "critic_adam"))


class JointCritics(Critics):
    """Critics of x = (state, all observations) and the actions of all agents.

    Args:
        sizes: numbers of agents and features.
        seeds: of the initial parameters, [K].
        hidden: sizes of the hidden layers, which have LayerNorm.
        **options: of `Critics`.
    """

    def __init__(
        self,
        sizes: Sizes,
        seeds: Sequence[int],
        hidden: tuple[int, ...],
        **options: Unpack[CriticOptions],
    ) -> None:
        super().__init__(
            sizes.information + sizes.n_agents * sizes.action, seeds, hidden, **options
        )
