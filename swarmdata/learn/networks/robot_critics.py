"""RobotCritics: J critics of each of K seeds that give one value for each robot.

One network serves all robots of a seed; it sees what `robot_views` describes, the robot's number
included. So the N values of Lowe et al. 2017 (equation 6) are N rows of one network.
"""

from collections.abc import Sequence
from typing import Unpack

import torch
from torch import Tensor

from swarmdata.learn.networks.critics import CriticOptions, Critics
from swarmdata.learn.networks.perceptrons import StackedMLP, mlp, mlp_of_branches
from swarmdata.learn.networks.robot_views import (
    Critic,
    InputNormalizer,
    RobotView,
    RobotViews,
)
from swarmdata.learn.networks.sizes import Sizes


class RobotCritics:
    """Values of joint actions for each robot, [K, J, B, N], with slow copies and an optimizer.

    Args:
        sizes: numbers of robots and features.
        normalizer: of observations and states.
        critic: `centralized` critics see the state and all actions, `decentralized` ones their
            robot's observation and action.
        seeds: of the initial parameters, [K].
        hidden: sizes of the hidden layers, which have LayerNorm.
        **options: of `Critics`.
    """

    def __init__(
        self,
        sizes: Sizes,
        normalizer: InputNormalizer,
        critic: Critic,
        seeds: Sequence[int],
        hidden: tuple[int, ...],
        **options: Unpack[CriticOptions],
    ) -> None:
        self._views = RobotViews(sizes, normalizer, critic, options.get("device", "cpu"))
        n_inputs = self._views.n_features + self._views.n_actions
        self._critics = Critics(n_inputs, seeds, hidden, **options)
        self.optimizer, self.n_critics = self._critics.optimizer, self._critics.n_critics
        self.online, self.target = self._critics.online, self._critics.target
        self.step, self.follow = self._critics.step, self._critics.follow
        self.state_dict = self._critics.state_dict
        self.load_state_dict = self._critics.load_state_dict

    @property
    def critic(self) -> Critic:
        """Whether the critics see the team, or their robot only."""
        return self._views.critic

    @property
    def n_features(self) -> int:
        """Features of a view, F."""
        return self._views.n_features

    def view(self, states: Tensor, observations: Tensor) -> RobotView:
        """Returns what the critics see of a batch; arguments as of `RobotViews.view`."""
        return self._views.view(states, observations)

    def q(self, view: RobotView, actions: Tensor) -> Tensor:
        """Returns all critics' values of joint actions [K, B, N, A], [K, J, B, N]."""
        return self._values(self._critics.online, view, actions)

    def target_q(self, view: RobotView, actions: Tensor, others: Tensor | None = None) -> Tensor:
        """Returns the values that the slow copies give, as `q`.

        Args:
            view: of the batch.
            actions: of the robots, [K, B, N, A].
            others: the actions that each robot's value supposes of the others; None: `actions`.
        """
        return self._values(self._critics.target, view, actions, others)

    def first_q(self, view: RobotView, own: Tensor, others: Tensor) -> Tensor:
        """Returns the first critics' values, [K, B, N], with their parameters as constants.

        Args:
            view: of the batch.
            own: each robot's action, [K, B, N, A].
            others: the actions that the others take meanwhile; `own` for a joint action.
        """
        seen = self._views.actions(view, own, others)
        layers = self._critics.online.constants(self.n_critics)
        return mlp_of_branches(layers, view.rows, seen[:, :, None]).view(own.shape[:3])

    def smallest_q(self, view: RobotView, own: Tensor, others: Tensor) -> Tensor:
        """Returns the smallest of the J values, [K, B, N]; constants and arguments as `first_q`."""
        seen = self._views.actions(view, own, others)
        return self._critics.smallest_q(view.rows, seen[:, :, None]).view(own.shape[:3])

    def sampled_q(self, view: RobotView, own: Tensor, others: Tensor) -> Tensor:
        """Returns all critics' values of M actions of each robot, [K, J, B, N, M].

        Args:
            view: of the batch.
            own: each robot's actions, of which it takes one, [K, B, M, N, A].
            others: the actions that the others take meanwhile, likewise; `own` for joint actions.
        """
        pairs = zip(own.unbind(2), others.unbind(2), strict=True)
        seen = torch.stack([self._views.actions(view, *pair) for pair in pairs], 2)
        shared, varied = (t.repeat_interleave(self.n_critics, 0) for t in (view.rows, seen))
        values = mlp_of_branches(self._critics.online.layers, shared, varied)  # [K J, B N, M, 1]
        return values.view(-1, self.n_critics, *own.shape[1:2], *own.shape[3:1:-1])

    def candidate_q(self, view: RobotView, candidates: Tensor, others: Tensor) -> Tensor:
        """Returns the smallest value of M actions of each robot, [K, B, N, M], as constants.

        Args:
            view: of the batch.
            candidates: each robot's actions, of which it takes one, [K, B, N, M, A].
            others: the actions that the others take meanwhile, [K, B, N, A].
        """
        n_candidates = candidates.shape[3]
        seen = [self._views.actions(view, own, others) for own in candidates.unbind(3)]
        values = self._critics.smallest_q(view.rows, torch.stack(seen, 2))
        return values.view(*others.shape[:3], n_candidates)

    def _values(
        self, network: StackedMLP, view: RobotView, actions: Tensor, others: Tensor | None = None
    ) -> Tensor:
        seen = self._views.actions(view, actions, actions if others is None else others)
        inputs = torch.cat([view.rows, seen], 2)
        values = mlp(network.layers, inputs.repeat_interleave(self.n_critics, 0))
        return values.view(-1, self.n_critics, *actions.shape[1:3])
