"""CORL's TD3+BC and IQL (tinkoff-ai/CORL, `algorithms/offline`), from a checkout.

The joint learner sees the team as one agent: all observations side by side, all actions, the mean
reward. So it knows at every robot what all of them observe. The other has one learner for each
robot, with its own observations, actions and rewards; that is MA-TD3+BC of the tables of Pan et al.
2022 (OMAR), whose repository does not have it.

Theirs: networks, losses, optimizers' rates, targets, schedules. Ours: batches, the number of
hidden units (theirs is 256), the number of updates. `d4rl`, `gym`, `pyrallis` and `wandb`, which
their files import for data, simulators, settings and logs, are absent.
"""

import copy
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from swarmdata import Policy
from swarmdata.types import Batch
from tests.benchmarks.peers.checkouts import read_module
from tests.benchmarks.peers.team_data import Budget, TeamData

ABSENT = ("d4rl", "gym", "pyrallis", "wandb")
Transitions = list[Tensor]
Learner = tuple[Callable[[Transitions], object], nn.Module]
"""What makes an update from states, actions, rewards, next states and ends; and the actor."""


def read(checkout: Path, name: str) -> Any:
    """Runs `algorithms/offline/NAME.py`."""
    return read_module(checkout / "algorithms" / "offline" / f"{name}.py", *ABSENT)


def of_width(network: nn.Sequential, units: int) -> nn.Sequential:
    """Returns the same layers, freshly initialized, with another number of hidden units."""
    last = [k for k, layer in enumerate(network) if isinstance(layer, nn.Linear)][-1]
    layers: list[nn.Module] = []
    n_inputs = None
    for k, layer in enumerate(network):
        if isinstance(layer, nn.Linear):
            n_outputs = layer.out_features if k == last else units
            layers.append(nn.Linear(n_inputs or layer.in_features, n_outputs))
            n_inputs = n_outputs
        else:
            layers.append(layer)
    return nn.Sequential(*layers)


LOW_ALPHA = 0.1
"""Weight of the value against imitation, where the default is 2.5.

TD3+BC divides by mean |Q|. Returns of these tasks cross 0, so that mean |Q| is small and imitation
hardly counts by default: after 4,000 updates on `coop_nav-medium-replay` actions are further from
the data than their mean is.
"""


def td3_bc(
    corl: Any, n_states: int, n_actions: int, budget: Budget, *, alpha: float | None = None
) -> Learner:
    """Makes what its `train` makes, with the defaults of its `TrainConfig` but for `alpha`."""
    config = corl.TrainConfig(device="cpu")
    actor = corl.Actor(n_states, n_actions, 1.0)
    critics = [corl.Critic(n_states, n_actions) for _ in range(2)]
    for network in (actor, *critics):
        network.net = of_width(network.net, budget.units)
    optimizers = [torch.optim.Adam(each.parameters(), lr=3e-4) for each in (actor, *critics)]
    learner = corl.TD3_BC(
        max_action=1.0,
        actor=actor,
        actor_optimizer=optimizers[0],
        critic_1=critics[0],
        critic_1_optimizer=optimizers[1],
        critic_2=critics[1],
        critic_2_optimizer=optimizers[2],
        discount=config.discount,
        tau=config.tau,
        policy_noise=config.policy_noise,
        noise_clip=config.noise_clip,
        policy_freq=config.policy_freq,
        alpha=config.alpha if alpha is None else alpha,
    )
    return learner.train, actor


def iql(corl: Any, n_states: int, n_actions: int, budget: Budget) -> Learner:
    """Makes what its `train` makes, with the defaults of its `TrainConfig`."""
    config = corl.TrainConfig(device="cpu")
    actor = corl.GaussianPolicy(n_states, n_actions, 1.0, hidden_dim=budget.units)
    critic = corl.TwinQ(n_states, n_actions, hidden_dim=budget.units)
    value = corl.ValueFunction(n_states, hidden_dim=budget.units)
    learner = corl.ImplicitQLearning(
        max_action=1.0,
        actor=actor,
        actor_optimizer=torch.optim.Adam(actor.parameters(), lr=config.actor_lr),
        q_network=critic,
        q_optimizer=torch.optim.Adam(critic.parameters(), lr=config.qf_lr),
        v_network=value,
        v_optimizer=torch.optim.Adam(value.parameters(), lr=config.vf_lr),
        iql_tau=config.iql_tau,
        beta=config.beta,
        max_steps=budget.n_updates,
        discount=config.discount,
        tau=config.tau,
    )
    return learner.train, actor


class Kind(NamedTuple):
    """A learner of CORL."""

    file: str  # of `algorithms/offline`
    make: Callable[[Any, int, int, Budget], Learner]


TD3_BC = Kind("td3_bc", td3_bc)
TD3_BC_LOW_ALPHA = Kind("td3_bc", partial(td3_bc, alpha=LOW_ALPHA))
IQL = Kind("iql", iql)


def joint(checkout: Path, data: TeamData, budget: Budget, seed: int, *, kind: Kind) -> Policy:
    """Trains one learner for the team as one agent."""
    _seed(seed)
    n, rng = data.n_agents, np.random.default_rng(seed)
    corl = read(checkout, kind.file)
    update, actor = kind.make(corl, n * data.n_observations, n * data.n_actions, budget)
    for _ in range(budget.n_updates):
        batch = data.draw(rng, budget.batch_size)
        update([
            batch.observations.flatten(1),
            batch.actions.flatten(1),
            batch.rewards.mean(1, keepdim=True),
            batch.next_observations.flatten(1),
            _ends(batch),
        ])  # fmt: skip
    act = _greedy(actor)
    return data.policy(lambda seen: act(seen.flatten(1)).view(-1, n, data.n_actions))


def per_robot(checkout: Path, data: TeamData, budget: Budget, seed: int, *, kind: Kind) -> Policy:
    """Trains one learner for each robot, on its own observations, actions and rewards."""
    _seed(seed)
    rng, corl = np.random.default_rng(seed), read(checkout, kind.file)
    learners = [
        kind.make(corl, data.n_observations, data.n_actions, budget) for _ in range(data.n_agents)
    ]
    for _ in range(budget.n_updates):
        batch = data.draw(rng, budget.batch_size)
        for i, (update, _) in enumerate(learners):
            update([
                batch.observations[:, i],
                batch.actions[:, i],
                batch.rewards[:, i, None],
                batch.next_observations[:, i],
                _ends(batch),
            ])  # fmt: skip
    actors = [_greedy(actor) for _, actor in learners]
    return data.policy(
        lambda seen: torch.stack([act(seen[:, i]) for i, act in enumerate(actors)], 1)
    )


def _seed(seed: int) -> None:
    """Their networks and noise draw from torch's global generator."""
    torch.manual_seed(seed)


def _ends(batch: Batch) -> Tensor:
    """A termination ends the bootstrap, a truncation does not, as in D4RL's `terminals`."""
    ends: Tensor = batch.terminations.float()[:, None]
    return ends


def _greedy(actor: nn.Module) -> Callable[[Tensor], Tensor]:
    """The action without noise, in float64: the mean of a Gaussian policy."""
    frozen = copy.deepcopy(actor).double().eval()

    def act(inputs: Tensor) -> Tensor:
        answer = frozen(inputs)
        chosen: Tensor = answer if isinstance(answer, Tensor) else answer.mean
        return chosen

    return act
