"""`bc` and `maddpg_bc` as in single-file implementations: one seed, torch modules, `.item()`.

In the manner of CORL's `algorithms/offline/td3_bc.py`. Networks, inputs, batches and losses are
those of ours, `maddpg_bc` with one stage; what critics see was made for all transitions before.
"""

import copy

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.functional import mse_loss


class Actor(nn.Module):
    """One for all robots; its inputs end with the robot's number."""

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
    """One for all robots: of what a robot's critic sees, and all actions, its own first."""

    def __init__(self, n_inputs: int, hidden: int) -> None:
        super().__init__()
        self.net = nn.Sequential(
            nn.Linear(n_inputs, hidden), nn.LayerNorm(hidden), nn.ReLU(),
            nn.Linear(hidden, hidden), nn.LayerNorm(hidden), nn.ReLU(),
            nn.Linear(hidden, 1),
        )  # fmt: skip

    def forward(self, x: Tensor, actions: Tensor) -> Tensor:
        n = actions.shape[1]
        slots = (torch.arange(n)[:, None] + torch.arange(n)) % n
        values: Tensor = self.net(torch.cat([x, actions[:, slots].flatten(2)], 2))
        return values[..., 0]  # [B, N]


def soft_update(target: nn.Module, source: nn.Module, tau: float) -> None:
    for slow, fast in zip(target.parameters(), source.parameters(), strict=True):
        slow.data.copy_((1 - tau) * slow.data + tau * fast.data)


class PlainBC:
    """One seed of behavior cloning.

    Data are `observations` with the robot's number [T, N, F] and `actions` [T, N, A].
    """

    def __init__(self, data: dict[str, Tensor], hidden: int, batch_size: int) -> None:
        self.data, self.batch_size = data, batch_size
        sizes = data["observations"].shape[2], data["actions"].shape[2]
        self.actor = Actor(*sizes, hidden)
        self.optimizer = torch.optim.Adam(self.actor.parameters(), lr=3e-3)

    def sample(self) -> dict[str, Tensor]:
        n_rows = len(self.data["actions"])
        index = np.random.randint(0, n_rows, size=self.batch_size)  # noqa: NPY002
        return {name: tensor[index] for name, tensor in self.data.items()}

    def train(self) -> dict[str, float]:
        batch = self.sample()
        loss = mse_loss(self.actor(batch["observations"]), batch["actions"])
        self.optimizer.zero_grad()
        torch.autograd.backward(loss)
        self.optimizer.step()
        return {"loss": loss.item()}


class PlainTD3BC(PlainBC):
    """One seed of TD3+BC with two critics of each robot.

    Data are those of `PlainBC`, with `next_observations`, `x` and `next_x`, what critics see
    besides actions [T, N, X], scaled `rewards` [T, N] and `terminations` [T, 1].
    """

    def __init__(self, data: dict[str, Tensor], hidden: int, batch_size: int) -> None:
        super().__init__(data, hidden, batch_size)
        self.total_it = 0
        self.largest = float(data["rewards"].abs().max()) / (1 - 0.95)
        self.actor_target = copy.deepcopy(self.actor)
        n_inputs = data["x"].shape[2] + data["actions"][0].numel()
        self.critic_1, self.critic_2 = Critic(n_inputs, hidden), Critic(n_inputs, hidden)
        self.critic_1_target = copy.deepcopy(self.critic_1)
        self.critic_2_target = copy.deepcopy(self.critic_2)
        self.critic_1_optimizer = torch.optim.Adam(self.critic_1.parameters(), lr=3e-3)
        self.critic_2_optimizer = torch.optim.Adam(self.critic_2.parameters(), lr=3e-3)

    def train(self) -> dict[str, float]:
        self.total_it += 1
        batch = self.sample()
        x, actions = batch["x"], batch["actions"]
        with torch.no_grad():
            noise = (torch.randn_like(actions) * 0.2).clamp(-0.5, 0.5)
            next_actions = (self.actor_target(batch["next_observations"]) + noise).clamp(-1, 1)
            target_q1 = self.critic_1_target(batch["next_x"], next_actions)
            target_q2 = self.critic_2_target(batch["next_x"], next_actions)
            next_q = torch.min(target_q1, target_q2).clamp(max=self.largest)
            target_q = batch["rewards"] + (1 - batch["terminations"]) * 0.95 * next_q
        current_q1, current_q2 = self.critic_1(x, actions), self.critic_2(x, actions)
        critic_loss = mse_loss(current_q1, target_q) + mse_loss(current_q2, target_q)
        log = {"critic_loss": critic_loss.item()}
        self.critic_1_optimizer.zero_grad()
        self.critic_2_optimizer.zero_grad()
        torch.autograd.backward(critic_loss)
        critics = [*self.critic_1.parameters(), *self.critic_2.parameters()]
        nn.utils.clip_grad_norm_(critics, 10.0)
        self.critic_1_optimizer.step()
        self.critic_2_optimizer.step()
        if self.total_it % 2 == 0:
            log["actor_loss"] = self._train_actor(x, batch["observations"], actions)
        return log

    def _train_actor(self, x: Tensor, seen: Tensor, actions: Tensor) -> float:
        pi = self.actor(seen)
        q = self.critic_1(x, pi)
        lmbda = 2.5 / q.abs().mean().detach().clamp(min=1.0)
        actor_loss = -lmbda * q.mean() + mse_loss(pi, actions)
        self.optimizer.zero_grad()
        torch.autograd.backward(actor_loss)
        nn.utils.clip_grad_norm_(self.actor.parameters(), 10.0)
        self.optimizer.step()
        soft_update(self.critic_1_target, self.critic_1, 0.01)
        soft_update(self.critic_2_target, self.critic_2, 0.01)
        soft_update(self.actor_target, self.actor, 0.01)
        return float(actor_loss.item())
