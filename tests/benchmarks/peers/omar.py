"""OMAR from its authors' code (ling-pan/OMAR, `algorithms/maddpg.py`), from a checkout.

Pan et al. 2022, "Plan Better Amid Conservatism". Theirs: networks (BatchNorm on inputs, one for
each robot), losses, CEM, rates, gradient clipping, and the coefficients that they chose for
cooperative navigation on each kind of dataset (`env_config_map`). Ours: batches, the number of
updates, and the unit of rewards.

Their file allocates on a GPU whatever device is chosen, and is of 2022. Here its calls of `cuda`
stay on the CPU, `view` reshapes what today's torch lays out otherwise, and distributions accept a
deviation of 0, to which CEM shrinks where all samples are clipped to one bound.
Their coefficients are for rewards of the particle world, whose returns-to-go deviate by tens, not
by one, and a weight of conservatism means something only in the unit of the values. `reward_scale`
multiplies our rewards, so that both can be measured.
"""

import copy
import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

import numpy as np
import torch
from torch import Tensor
from torch.distributions import Distribution

from swarmdata import Policy
from tests.benchmarks.peers.checkouts import import_from
from tests.benchmarks.peers.team_data import Budget, TeamData

WORLD = "simple_spread"
"""Their name of cooperative navigation, whose coefficients are used."""

TYPES = ("random", "medium-replay", "medium", "expert")
"""Kinds of datasets in `env_config_map`."""

PARTICLE_SCALE = 40.0
"""Roughly the deviation of the returns-to-go in their data: returns of 25 steps deviate by 60 to 92
(OG-MARL's dataset card of simple_spread), most of it at a discount of 0.95."""


DEFAULTS: dict[str, Any] = {
    "gamma": 0.95, "tau": 0.01, "lr": 0.01, "lse_temp": 1.0, "num_sampled_actions": 10,
    "omar": True, "omar_iters": 3, "omar_mu": 0.0, "omar_sigma": 2.0, "omar_num_samples": 10,
    "omar_num_elites": 10,
}  # fmt: skip
"""Those of their command line with `--omar 1`."""


@contextmanager
def as_in_2022() -> Iterator[None]:
    """Lets calls of `cuda` do nothing, `view` copy where it has to, and deviations be 0."""
    with (
        patch.object(torch.Tensor, "cuda", lambda tensor: tensor),
        patch.object(torch.Tensor, "view", torch.Tensor.reshape),
        patch.object(torch.cuda, "FloatTensor", torch.FloatTensor),
        patch.object(Distribution, "_validate_args", False),
        warnings.catch_warnings(),
    ):
        warnings.simplefilter("ignore", FutureWarning)  # clip_grad_norm is called by its old name
        yield


def omar(
    checkout: Path, data: TeamData, budget: Budget, seed: int, *, reward_scale: float = 1.0
) -> Policy:
    """Trains one learner for each robot."""
    torch.manual_seed(seed)
    rng = np.random.default_rng(seed)
    team = _team(checkout, data, budget)
    with as_in_2022():
        team.prep_training(device="cpu")
        for _ in range(budget.n_updates):
            for robot in range(data.n_agents):
                team.update(_sample(data, rng, budget.batch_size, reward_scale), robot)
            team.update_all_targets()
        team.prep_rollouts(device="cpu")
    actors = [copy.deepcopy(policy).double().eval() for policy in team.policies]
    return data.policy(
        lambda seen: torch.stack([actor(seen[:, i]) for i, actor in enumerate(actors)], 1)
    )


def data_type(dataset_id: str) -> str:
    """The kind of dataset, in their words, by which coefficients are chosen.

    Raises:
        ValueError: they have no coefficients for it.
    """
    kind = re.sub(r"(-mini)?(-v\d+)?$", "", dataset_id.partition("-")[2])
    if kind not in TYPES:
        raise ValueError(
            f"OMAR's coefficients depend on the kind of dataset; got {dataset_id!r}, expected an "
            f"id that ends in one of {', '.join(TYPES)}"
        )
    return kind


def _team(checkout: Path, data: TeamData, budget: Budget) -> Any:
    module = import_from(checkout, "algorithms.maddpg")
    space = SimpleNamespace(shape=(data.n_actions,), high=np.ones(data.n_actions))
    seen = SimpleNamespace(shape=(data.n_observations,))
    world = SimpleNamespace(
        agent_types=["agent"] * data.n_agents,
        action_space=[space] * data.n_agents,
        observation_space=[seen] * data.n_agents,
    )
    sizes = {"hidden_dim": budget.units, "batch_size": budget.batch_size}
    with as_in_2022():
        return module.MATD3.init_from_env(world, WORLD, data_type(data.id), **DEFAULTS, **sizes)


def _sample(data: TeamData, rng: np.random.Generator, n: int, reward_scale: float) -> Any:
    """Lists by robot: observations, actions, rewards, next observations, ends."""
    batch = data.draw(rng, n)
    ends = batch.terminations.float()
    columns: list[list[Tensor]] = [
        list(batch.observations.unbind(1)),
        list(batch.actions.unbind(1)),
        list((reward_scale * batch.rewards).unbind(1)),
        list(batch.next_observations.unbind(1)),
        [ends] * data.n_agents,
    ]
    return columns
