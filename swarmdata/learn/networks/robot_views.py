"""What a critic of each robot sees: that robot alone, or the whole team, always in one frame.

A critic of robot i that is `decentralized` sees (o_i, i, a_i). One that is `centralized` sees
(o_i, i, s, a_i, a_i+1, ..., a_i-1), numbers modulo N (Lowe et al. 2017, equation 6, with o_i and
the state for x). Everything is in robot i's frame: the policies' observations and actions are each
in the frame of their own robot, so the actions of the others are turned into robot i's, and the
planar vectors of the state, positions included, are turned about the middle of the arena. The
robots of the state come in the same order as the actions, robot i first, so that one network serves
all robots. Without a frame (recordings of other environments) everything is in the world's.
"""

from dataclasses import dataclass
from typing import Literal, Protocol

import torch
from torch import Tensor

from swarmdata.learn.networks.network_inputs import with_agent_id
from swarmdata.learn.networks.sizes import Sizes

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
    """What critics see of a batch besides actions, and how they see actions.

    Attributes:
        features: in each robot's frame, its number included, [K, B, N, F].
        cosines: of the angle from robot i's frame to that of the robot in each slot, [K, B, N, N];
            None if critics see their own action only, or nothing is turned.
        sines: likewise.
    """

    features: Tensor
    cosines: Tensor | None = None
    sines: Tensor | None = None

    @property
    def rows(self) -> Tensor:
        """The features by network row, [K, B N, F]."""
        return self.features.flatten(1, 2)


class RobotViews:
    """Makes views of batches for critics of one kind.

    Args:
        sizes: numbers of robots and features.
        normalizer: of observations and states.
        critic: whether critics see the team.
        device: where batches are.

    Attributes:
        critic: whether critics see the team.
    """

    def __init__(
        self,
        sizes: Sizes,
        normalizer: InputNormalizer,
        critic: Critic,
        device: torch.device | str,
    ) -> None:
        n = sizes.n_agents
        self._sizes, self._normalizer, self.critic = sizes, normalizer, critic
        slots = torch.arange(n, device=device)
        self._order = (slots[:, None] + slots) % n  # [N, N]: the robot in each slot of robot i
        self._vectors = torch.tensor(sizes.state_vectors, dtype=torch.long, device=device)
        self._columns = self._state_order(sizes, device)
        mean, std = normalizer.state_mean.clone(), normalizer.state_std.clone()
        if sizes.frame is not None:
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
        """Numbers that a critic sees of a joint action: A, or N A."""
        return self._sizes.action * (self._sizes.n_agents if self.critic == "centralized" else 1)

    def view(self, states: Tensor, observations: Tensor) -> RobotView:
        """Returns the view of a batch.

        Args:
            states: as recorded, [K, B, S].
            observations: in the robots' frames, not normalized, [K, B, N, O].
        """
        own = with_agent_id(self._normalizer.observations(observations))
        if self.critic == "decentralized":
            return RobotView(own)
        standard = (states - self._state_mean) / self._state_std
        turned = standard[:, :, None].expand(-1, -1, self._sizes.n_agents, -1)  # [K, B, N, S]
        cosines = sines = None
        if self._sizes.frame is not None:
            first = self._sizes.observation - self._sizes.frame.n_added
            ux, uy = observations[..., first], observations[..., first + 1]  # [K, B, N]
            turned = self._turned(turned, ux[..., None], uy[..., None])
            wx, wy = ux[:, :, self._order], uy[:, :, self._order]  # of each slot, [K, B, N, N]
            cosines = ux[..., None] * wx + uy[..., None] * wy
            sines = ux[..., None] * wy - uy[..., None] * wx
        columns = self._columns.expand(*turned.shape)
        return RobotView(torch.cat([own, turned.gather(3, columns)], 3), cosines, sines)

    def actions(self, view: RobotView, own: Tensor, others: Tensor) -> Tensor:
        """Returns actions as the critics see them, by network row, [K, B N, A] or [K, B N, N A].

        Args:
            view: of the batch.
            own: each robot's action in its own frame, [K, B, N, A].
            others: the actions that the others take meanwhile, likewise; `own` for a joint action.
        """
        if self.critic == "decentralized":
            return own.flatten(1, 2)
        slots = torch.cat([own[:, :, :, None], others[:, :, self._order[:, 1:]]], 3)
        if view.cosines is not None and view.sines is not None:
            x, y = slots[..., 0], slots[..., 1]  # [K, B, N, N]
            ahead, left = view.cosines * x - view.sines * y, view.sines * x + view.cosines * y
            slots = torch.cat([torch.stack([ahead, left], -1), slots[..., 2:]], -1)
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
