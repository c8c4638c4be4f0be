"""Fine-tunes a policy in a world, from a TorchRL buffer of recorded and of new transitions.

    python tests/examples/offline_to_online.py [DATASET]

Half of every batch is recorded (`OfflineToOnlineReplayBuffer` of TorchRL 0.14); the other half was
collected in `swarmdata.make_torchrl_env`. The learner is TD3+BC (Fujimoto and Gu 2021) of single
robots that share their networks, without its delayed updates. It prints success before and after.
"""

import sys
from dataclasses import dataclass, field
from typing import Any

import torch
from tensordict.nn import TensorDictModule
from torch import Tensor, nn
from torchrl.data import OfflineToOnlineReplayBuffer

import swarmdata

KEYS = (
    ("agents", "observation"),
    ("agents", "action"),
    ("next", "agents", "observation"),
    ("next", "agents", "reward"),
    ("next", "terminated"),
)
"""What the learner reads: recorded and new transitions have it alike."""

BATCH, DISCOUNT, TAU, RL_WEIGHT, NOISE = 256, 0.95, 0.01, 2.5, 0.1


def network(n_inputs: int, n_outputs: int, last: nn.Module) -> nn.Module:
    """Two hidden layers."""
    layers = [nn.Linear(n_inputs, 128), nn.ReLU(), nn.Linear(128, 128), nn.ReLU()]
    return nn.Sequential(*layers, nn.Linear(128, n_outputs), last)


@dataclass
class Learner:
    """TD3+BC of one robot; every robot is one."""

    n_observations: int
    n_actions: int
    optimizer: Any = field(init=False)

    def __post_init__(self) -> None:
        n_both = self.n_observations + self.n_actions
        self.actor = network(self.n_observations, self.n_actions, nn.Tanh())
        self.critic, self.target = (network(n_both, 2, nn.Identity()) for _ in range(2))
        self.target.load_state_dict(self.critic.state_dict())
        parameters = [*self.actor.parameters(), *self.critic.parameters()]
        self.optimizer = torch.optim.Adam(parameters, lr=3e-4)

    def update(self, batch: Any) -> dict[str, float]:
        """One step on transitions of all robots."""
        seen, action = batch["agents", "observation"], batch["agents", "action"]
        after, reward = batch["next", "agents", "observation"], batch["next", "agents", "reward"]
        with torch.no_grad():
            noise = (0.2 * torch.randn_like(action)).clamp(-0.5, 0.5)
            chosen = (self.actor(after) + noise).clamp(-1, 1)
            value = self.target(torch.cat([after, chosen], -1)).min(-1, keepdim=True).values
            goes_on = ~batch["next", "terminated"].unsqueeze(1)  # truncation is no end
            wanted = reward + DISCOUNT * goes_on * value
        td = (self.critic(torch.cat([seen, action], -1)) - wanted).square().mean()
        proposed = self.actor(seen)
        self.critic.requires_grad_(False)
        value = self.critic(torch.cat([seen, proposed], -1))[..., 0]
        self.critic.requires_grad_(True)
        cloning = (proposed - action).square().mean()
        rl = -RL_WEIGHT * value.mean() / value.abs().mean().detach()
        self.optimizer.zero_grad()
        (td + rl + cloning).backward()
        self.optimizer.step()
        with torch.no_grad():
            for theirs, ours in zip(
                self.target.parameters(), self.critic.parameters(), strict=True
            ):
                theirs.lerp_(ours, TAU)
        return {"td": td.item(), "cloning": cloning.item()}

    def act(self, observations: Tensor) -> Tensor:
        """Greedy actions."""
        with torch.no_grad():
            return self.actor(observations)


def collect(env: Any, learner: Learner, n_steps: int) -> Any:
    """New transitions of all copies, with noise on the actions, [n]."""

    def explore(observations: Tensor) -> Tensor:
        actions = learner.act(observations)
        return (actions + NOISE * torch.randn_like(actions)).clamp(-1, 1)

    policy = TensorDictModule(explore, in_keys=KEYS[:1], out_keys=KEYS[1:2])
    rows = env.rollout(n_steps, policy, break_when_any_done=False)
    return rows.select(*KEYS).reshape(-1)


def success(learner: Learner, spec: swarmdata.TaskSpec, n_episodes: int) -> float:
    """The share of reserved episodes that the greedy policy solves."""
    policy = swarmdata.FunctionPolicy(lambda rows: learner.act(torch.from_numpy(rows)))
    result = swarmdata.evaluate(policy, spec, name="TD3+BC", n_episodes=n_episodes, progress=False)
    return float(result.metrics["success"].mean())


def main(
    dataset: str = "coop_nav-medium-mini",
    n_offline: int = 3000,
    n_rounds: int = 100,
    n_episodes: int = 200,
) -> tuple[float, float]:
    """Learns offline, then in the world; prints and returns success after each."""
    torch.manual_seed(0)
    view = swarmdata.load(dataset).split("train")
    spec = view.spec
    assert isinstance(spec, swarmdata.TaskSpec), f"{dataset} has no world to learn in"
    env = swarmdata.make_torchrl_env(spec, 32, seed=0)
    recorded = view.replay_buffer(None, keys=KEYS)
    buffer = OfflineToOnlineReplayBuffer(
        recorded, online_capacity=200_000, offline_fraction=0.5, batch_size=BATCH
    )
    keys = ("agents", "observation"), ("agents", "action")
    sizes = (env.full_observation_spec[keys[0]], env.full_action_spec[keys[1]])
    learner = Learner(*(size.shape[-1] for size in sizes))
    for _ in range(n_offline):
        learner.update(buffer.sample())  # the online half is empty: all of it is recorded
    before = success(learner, spec, n_episodes)
    for _ in range(n_rounds):
        buffer.extend(collect(env, learner, 20))
        for _ in range(20):
            learner.update(buffer.sample())
    after = success(learner, spec, n_episodes)
    print(f"success {before:.1%} offline, {after:.1%} after {len(buffer.online_buffer):,} steps")
    return before, after


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "coop_nav-medium-mini")
