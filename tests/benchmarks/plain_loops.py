"""TD3+BC for a team as single-file implementations write it: one seed, torch modules, `.item()`.

Written for the benchmark from Fujimoto & Gu 2021 (eq. 3-5) in the manner of CORL's
`algorithms/offline/td3_bc.py`: a module per critic, an optimizer each, targets as deep copies that
a loop over parameters moves, the dataset as tensors in memory, drawn by fancy indexing. Its critics
give one value of the team, where those of `maddpg_bc` give one for each robot.
"""

import copy

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.functional import mse_loss

from swarmdata.types import Batch


class Actor(nn.Module):
    """One for all agents; its inputs end with the agent's number."""

    def __init__(self, n_inputs: int, n_actions: int, hidden: int) -> None:
        super().__init__()
        self.net = nn.Sequential(
            nn.Linear(n_inputs, hidden), nn.ReLU(),
            nn.Linear(hidden, hidden), nn.ReLU(),
            nn.Linear(hidden, n_actions), nn.Tanh(),
        )  # fmt: skip

    def forward(self, observations: Tensor) -> Tensor:
        actions: Tensor = self.net(observations)
        return actions


class Critic(nn.Module):
    """Of the state, all observations and all actions."""

    def __init__(self, n_inputs: int, hidden: int) -> None:
        super().__init__()
        self.net = nn.Sequential(
            nn.Linear(n_inputs, hidden), nn.LayerNorm(hidden), nn.ReLU(),
            nn.Linear(hidden, hidden), nn.LayerNorm(hidden), nn.ReLU(),
            nn.Linear(hidden, 1),
        )  # fmt: skip

    def forward(self, x: Tensor, actions: Tensor) -> Tensor:
        values: Tensor = self.net(torch.cat([x, actions.flatten(1)], 1))
        return values


def soft_update(target: nn.Module, source: nn.Module, tau: float) -> None:
    """Polyak averaging, parameter by parameter."""
    for slow, fast in zip(target.parameters(), source.parameters(), strict=True):
        slow.data.copy_((1 - tau) * slow.data + tau * fast.data)


class PlainTD3BC:
    """One seed.

    Args:
        data: all transitions, tensors [T, ...]; observations and states are normalized.
        hidden: size of both hidden layers of every network.
        batch_size: joint transitions of an update.
    """

    def __init__(self, data: Batch, hidden: int, batch_size: int = 256) -> None:
        n_agents = data.observations.shape[1]
        identity = torch.eye(n_agents).expand(len(data.observations), n_agents, n_agents)
        observations, following = (
            torch.cat([torch.as_tensor(seen), identity], 2)
            for seen in (data.observations, data.next_observations)
        )
        x, x_next = (
            torch.cat([torch.as_tensor(s), torch.as_tensor(o).flatten(1)], 1)
            for s, o in (
                (data.states, data.observations),
                (data.next_states, data.next_observations),
            )
        )
        rewards = torch.as_tensor(data.rewards).mean(1, keepdim=True)
        dones = torch.as_tensor(data.terminations).float()[:, None]
        actions = torch.as_tensor(data.actions)
        self.tensors = [x, observations, actions, rewards, x_next, following, dones]
        self.batch_size, self.total_it = batch_size, 0
        self.actor = Actor(observations.shape[2], actions.shape[2], hidden)
        self.actor_target = copy.deepcopy(self.actor)
        self.actor_optimizer = torch.optim.Adam(self.actor.parameters(), lr=1e-3)
        n_inputs = x.shape[1] + actions[0].numel()
        self.critic_1, self.critic_2 = Critic(n_inputs, hidden), Critic(n_inputs, hidden)
        self.critic_1_target = copy.deepcopy(self.critic_1)
        self.critic_2_target = copy.deepcopy(self.critic_2)
        self.critic_1_optimizer = torch.optim.Adam(self.critic_1.parameters(), lr=3e-4)
        self.critic_2_optimizer = torch.optim.Adam(self.critic_2.parameters(), lr=3e-4)

    def sample(self) -> list[Tensor]:
        """Rows drawn with replacement."""
        index = np.random.randint(0, len(self.tensors[0]), size=self.batch_size)  # noqa: NPY002
        return [tensor[index] for tensor in self.tensors]

    def train(self) -> dict[str, float]:
        """One update."""
        self.total_it += 1
        x, seen, actions, rewards, x_next, seen_next, dones = self.sample()
        with torch.no_grad():
            noise = (torch.randn_like(actions) * 0.2).clamp(-0.5, 0.5)
            next_actions = (self.actor_target(seen_next) + noise).clamp(-1, 1)
            target_q1 = self.critic_1_target(x_next, next_actions)
            target_q2 = self.critic_2_target(x_next, next_actions)
            target_q = rewards + (1 - dones) * 0.95 * torch.min(target_q1, target_q2)
        current_q1, current_q2 = self.critic_1(x, actions), self.critic_2(x, actions)
        critic_loss = mse_loss(current_q1, target_q) + mse_loss(current_q2, target_q)
        log = {"critic_loss": critic_loss.item()}
        self.critic_1_optimizer.zero_grad()
        self.critic_2_optimizer.zero_grad()
        torch.autograd.backward(critic_loss)
        self.critic_1_optimizer.step()
        self.critic_2_optimizer.step()
        if self.total_it % 2 == 0:
            log["actor_loss"] = self._train_actor(x, seen, actions)
        return log

    def _train_actor(self, x: Tensor, seen: Tensor, actions: Tensor) -> float:
        pi = self.actor(seen)
        q = self.critic_1(x, pi)
        lmbda = 1.0 / q.abs().mean().detach()
        actor_loss = -lmbda * q.mean() + (pi - actions).square().sum(1).mean()
        self.actor_optimizer.zero_grad()
        torch.autograd.backward(actor_loss)
        self.actor_optimizer.step()
        soft_update(self.critic_1_target, self.critic_1, 0.01)
        soft_update(self.critic_2_target, self.critic_2, 0.01)
        soft_update(self.actor_target, self.actor, 0.01)
        return float(actor_loss.item())
