"""Critics: the values of joint actions that K seeds learn, with slowly moving targets.

A critic is a network of x = (state, all observations) and the actions of all agents (Lowe et al.
2017, eq. 6). Each seed has J of them, usually two (Fujimoto et al. 2018, section 4.2).

The N values of `RobotCritics` are N rows of one network. `decentralized` critics see (o_i, i, a_i),
`centralized` ones (o_i, i, s, a_i, a_i+1, ..., a_i-1), numbers modulo N. Everything is turned into
robot i's frame: the actions of the others from theirs, and the planar vectors of the state,
positions included, about the middle of the arena. The commands of unicycles are a speed along their
heading, which is turned like a vector, and a turn rate, which stays a number. The robots of the
state come in the order of the actions, robot i first. Without a frame (recordings of other
environments) nothing is turned.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Protocol, Required, TypedDict, Unpack

import torch
from torch import Tensor

from swarmdata.learn.networks.actor import CRITIC_STREAM
from swarmdata.learn.networks.network_inputs import with_agent_id
from swarmdata.learn.networks.optimizer import Descent
from swarmdata.learn.networks.perceptrons import (
    MLPShape,
    StackedMLP,
    initialize,
    mlp,
    mlp_of_branches,
)
from swarmdata.learn.networks.setup import Sizes

JointGradient = Literal["all", "own"]
"""Whose actions the policy gives in its own loss: those of all agents, or of one at a time."""


def others_of(joint_gradient: JointGradient, pi: Tensor, actions: Tensor) -> Tensor:
    """Returns what the others do in a robot's value, [K, B, N, A]: as pi, or as in the data."""
    return pi if joint_gradient == "all" else actions


class CriticOptions(TypedDict, total=False):
    """What critics are told by keyword."""

    learning_rate: Required[float]  # of Adam
    max_norm: Required[float | None]  # of the gradient of one seed's critics; None does not clip
    n_critics: int  # critics of a seed, J; two if absent
    device: torch.device | str  # where to train
    name: str  # of the networks in checkpoints; "critics" if absent


class CriticEnsemble(Descent):
    """J perceptrons of each of K seeds with one output, their slow copies, and their optimizer.

    `n_inputs` are the features that a critic sees, actions included; hidden layers have LayerNorm.
    """

    def __init__(
        self,
        n_inputs: int,
        seeds: Sequence[int],
        hidden: tuple[int, ...],
        **options: Unpack[CriticOptions],
    ) -> None:
        self.n_critics = options.get("n_critics", 2)
        shape = MLPShape(n_inputs, hidden, 1, layer_norm=True)
        # rows are seed 0 critic 0, seed 0 critic 1, ..., seed 1 critic 0, ...
        self.online = StackedMLP(shape, self.n_critics * len(seeds), options.get("device", "cpu"))
        initialize(self.online, seeds, CRITIC_STREAM)
        name = options.get("name", "critics")
        super().__init__(
            {name: self.online}, len(seeds), options["learning_rate"], options["max_norm"],
            followed=(name,), moments={"critics": "critic_adam"},
        )  # fmt: skip
        self.target: StackedMLP = self.targets[name]

    def smallest_of(self, x: Tensor, varied: Tensor) -> Tensor:
        """Returns the smallest of the J values of M actions in each row, [K, B, M]; constants.

        `x` are critic inputs besides actions, [K, B, F], `varied` actions as critics see them, [K,
        B, M, D].
        """
        shared, branches = (t.repeat_interleave(self.n_critics, 0) for t in (x, varied))
        values = mlp_of_branches(self.online.constants(), shared, branches)[..., 0]
        return values.view(-1, self.n_critics, *values.shape[1:]).amin(1)


class Critics(CriticEnsemble):
    """Critics of x, [K, B, S + N O], and joint actions, [K, B, N, A], that give one value.

    x is normalized: `network_inputs.information`.
    """

    def q(self, x: Tensor, actions: Tensor) -> Tensor:
        """Returns all critics' values, [K, J, B, 1]."""
        return self._values(self.online, x, actions)

    def target_q(self, x: Tensor, actions: Tensor) -> Tensor:
        return self._values(self.target, x, actions)

    def _values(self, network: StackedMLP, x: Tensor, actions: Tensor) -> Tensor:
        inputs = torch.cat([x, actions.flatten(2)], 2)
        values = network(inputs.repeat_interleave(self.n_critics, 0))
        return values.view(-1, self.n_critics, *values.shape[1:])

    def sampled_q(self, x: Tensor, actions: Tensor) -> Tensor:
        """Returns all critics' values, [K, J, B, M, 1], of M joint actions, [K, B, M, N, A]."""
        shared, varied = (t.repeat_interleave(self.n_critics, 0) for t in (x, actions.flatten(3)))
        values = mlp_of_branches(self.online.layers, shared, varied)
        return values.view(-1, self.n_critics, *values.shape[1:])

    def first_q(self, x: Tensor, actions: Tensor) -> Tensor:
        """Returns the first critics' values, [K, B, 1]; the critics' parameters are constants."""
        joint = torch.cat([x, actions.flatten(2)], 2)
        return self.online.frozen(joint, every=self.n_critics)

    def first_sampled_q(self, x: Tensor, actions: Tensor) -> Tensor:
        """Returns the first critics' values, [K, B, M, 1], as constants, of [K, B, M, N, A]."""
        return mlp_of_branches(self.online.constants(self.n_critics), x, actions.flatten(3))


Critic = Literal["centralized", "decentralized"]
"""Whether a robot's critic sees the team, or that robot only."""


class InputNormalizer(Protocol):
    """Moments of states, and observations in units of theirs."""

    @property
    def state_mean(self) -> Tensor: ...  # [S], or by seed [K, 1, S]
    @property
    def state_std(self) -> Tensor: ...  # likewise
    def observations(self, observations: Tensor) -> Tensor: ...  # [K, B, N, O]


@dataclass(frozen=True, slots=True, eq=False)
class RobotView:
    """What critics see of a batch besides actions, and how they see actions."""

    features: Tensor  # in each robot's frame, its number included, [K, B, N, F]
    cosines: Tensor | None = None
    """Of the angle from robot i's frame to that of the robot in each slot, [K, B, N, N]; None if
    critics see their own action only, or nothing is turned."""
    sines: Tensor | None = None  # likewise

    @property
    def rows(self) -> Tensor:
        """The features by network row, [K, B N, F]."""
        return self.features.flatten(1, 2)


class RobotViews:
    """Makes views of batches for critics of one kind."""

    def __init__(
        self, sizes: Sizes, normalizer: InputNormalizer, critic: Critic, device: torch.device | str
    ) -> None:
        n = sizes.n_agents
        self._sizes, self._normalizer, self.critic = sizes, normalizer, critic
        slots = torch.arange(n, device=device)
        self._order = (slots[:, None] + slots) % n  # [N, N]: the robot in each slot of robot i
        self._vectors = torch.tensor(sizes.state_vectors, dtype=torch.long, device=device)
        self._columns = self._state_order(sizes, device)
        mean, std = normalizer.state_mean.clone(), normalizer.state_std.clone()
        if sizes.frame is not None:
            self._axis = sizes.observation - sizes.frame.n_added  # column of the frame's x axis
            # whether the second command of the robot in each slot is a component, [N, N]
            self._is_vector = torch.from_numpy(sizes.frame.turns(n)).to(device)[self._order]
            # turned vectors have no preferred direction: no mean, and one deviation for x and y
            x, y = self._vectors, self._vectors + 1
            moments = mean.square() + std.square()
            mean[..., x] = mean[..., y] = 0.0
            std[..., x] = std[..., y] = ((moments[..., x] + moments[..., y]) / 2).sqrt()
        self._state_mean, self._state_std = mean, torch.where(std < 1e-3, 1.0, std)

    @property
    def n_features(self) -> int:
        """Number of features besides actions, F."""
        sizes = self._sizes
        own = sizes.observation + sizes.n_agents
        return own + (sizes.state if self.critic == "centralized" else 0)

    @property
    def n_actions(self) -> int:
        """Numbers that a critic sees of a joint action: A, or N (A + T)."""
        sizes = self._sizes
        if self.critic == "decentralized":
            return sizes.action
        return sizes.n_agents * (sizes.action + self._n_turn_rates)

    @property
    def _n_turn_rates(self) -> int:
        """Numbers that turning adds to an action, T: a turn rate in teams with unicycles."""
        return 0 if self._sizes.frame is None or bool(self._is_vector.all()) else 1

    def view(self, states: Tensor, observations: Tensor) -> RobotView:
        """Returns the view of states as recorded, [K, B, S].

        Observations are in the robots' frames, not normalized, [K, B, N, O].
        """
        own = with_agent_id(self._normalizer.observations(observations))
        if self.critic == "decentralized":
            return RobotView(own)
        standard = (states - self._state_mean) / self._state_std
        turned = standard[:, :, None].expand(-1, -1, self._sizes.n_agents, -1)  # [K, B, N, S]
        cosines = sines = None
        if self._sizes.frame is not None:
            ux, uy = observations[..., self._axis], observations[..., self._axis + 1]  # [K, B, N]
            turned = self._turned(turned, ux[..., None], uy[..., None])
            wx, wy = ux[:, :, self._order], uy[:, :, self._order]  # of each slot, [K, B, N, N]
            cosines = ux[..., None] * wx + uy[..., None] * wy
            sines = ux[..., None] * wy - uy[..., None] * wx
        columns = self._columns.expand(*turned.shape)
        return RobotView(torch.cat([own, turned.gather(3, columns)], 3), cosines, sines)

    def actions(self, view: RobotView, own: Tensor, others: Tensor) -> Tensor:
        """Returns actions as critics see them, by network row, [K, B N, A] or [K, B N, N (A + T)].

        `own` are the robots' actions, [K, B, N, A], `others` those that the others take meanwhile,
        [K, B, N, A], or `own` again for a joint action; each in the frame of the robot that acts.
        """
        if self.critic == "decentralized":
            return own.flatten(1, 2)
        slots = torch.cat([own[:, :, :, None], others[:, :, self._order[:, 1:]]], 3)
        if view.cosines is not None and view.sines is not None:
            x, y = slots[..., 0], slots[..., 1]  # [K, B, N, N]
            turn_rates = []
            if self._n_turn_rates:
                turn_rates = [torch.where(self._is_vector, 0.0, y)]
                y = torch.where(self._is_vector, y, 0.0)
            ahead, left = view.cosines * x - view.sines * y, view.sines * x + view.cosines * y
            slots = torch.cat([torch.stack([ahead, left, *turn_rates], -1), slots[..., 2:]], -1)
        return slots.flatten(3).flatten(1, 2)

    def _turned(self, states: Tensor, ux: Tensor, uy: Tensor) -> Tensor:
        x, y = states[..., self._vectors], states[..., self._vectors + 1]
        turned = states.clone()
        turned[..., self._vectors] = ux * x + uy * y
        turned[..., self._vectors + 1] = ux * y - uy * x
        return turned

    def _state_order(self, sizes: Sizes, device: torch.device | str) -> Tensor:
        """Column of the state in each place of robot i's view, [N, S]."""
        n, width = sizes.n_agents, sizes.robot_columns
        of_robots = self._order[..., None] * width + torch.arange(width, device=device)
        rest = torch.arange(n * width, sizes.state, device=device).expand(n, -1)
        return torch.cat([of_robots.flatten(1), rest], 1)


class RobotCritics(CriticEnsemble):
    """Values of joint actions for each robot, [K, J, B, N], with slow copies and an optimizer.

    Robots' actions `own` and those that the others take meanwhile are [K, B, N, A], both the same
    for a joint action. Hidden layers have LayerNorm.
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
        self._views = views = RobotViews(sizes, normalizer, critic, options.get("device", "cpu"))
        super().__init__(views.n_features + views.n_actions, seeds, hidden, **options)
        self.critic, self.n_features, self.view = critic, views.n_features, views.view

    def q(self, view: RobotView, actions: Tensor) -> Tensor:
        """Returns all critics' values, [K, J, B, N], of joint actions, [K, B, N, A]."""
        return self._values(self.online, view, actions)

    def target_q(self, view: RobotView, actions: Tensor, others: Tensor | None = None) -> Tensor:
        return self._values(self.target, view, actions, others)

    def first_q(self, view: RobotView, own: Tensor, others: Tensor) -> Tensor:
        """Returns the first critics' values, [K, B, N], with their parameters as constants."""
        seen = self._views.actions(view, own, others)
        layers = self.online.constants(self.n_critics)
        return mlp_of_branches(layers, view.rows, seen[:, :, None]).view(own.shape[:3])

    def smallest_q(self, view: RobotView, own: Tensor, others: Tensor) -> Tensor:
        """Returns the smallest of the J values, [K, B, N], with parameters as constants."""
        seen = self._views.actions(view, own, others)
        return self.smallest_of(view.rows, seen[:, :, None]).view(own.shape[:3])

    def sampled_q(self, view: RobotView, own: Tensor, others: Tensor) -> Tensor:
        """Returns all critics' values, [K, J, B, N, M], of M actions a robot, [K, B, M, N, A]."""
        pairs = zip(own.unbind(2), others.unbind(2), strict=True)
        seen = torch.stack([self._views.actions(view, *pair) for pair in pairs], 2)
        shared, varied = (t.repeat_interleave(self.n_critics, 0) for t in (view.rows, seen))
        values = mlp_of_branches(self.online.layers, shared, varied)  # [K J, B N, M, 1]
        return values.view(-1, self.n_critics, *own.shape[1:2], *own.shape[3:1:-1])

    def candidate_q(self, view: RobotView, candidates: Tensor, others: Tensor) -> Tensor:
        """Returns the smallest values, [K, B, N, M], as constants, of M actions of each robot.

        `candidates` are [K, B, N, M, A], of which a robot takes one; `others` stay, [K, B, N, A].
        """
        n_candidates = candidates.shape[3]
        seen = [self._views.actions(view, own, others) for own in candidates.unbind(3)]
        values = self.smallest_of(view.rows, torch.stack(seen, 2))
        return values.view(*others.shape[:3], n_candidates)

    def _values(
        self, network: StackedMLP, view: RobotView, actions: Tensor, others: Tensor | None = None
    ) -> Tensor:
        seen = self._views.actions(view, actions, actions if others is None else others)
        inputs = torch.cat([view.rows, seen], 2)
        values = mlp(network.layers, inputs.repeat_interleave(self.n_critics, 0))
        return values.view(-1, self.n_critics, *actions.shape[1:3])
