"""Conversion of policies between online runs and checkpoints for exact inference."""

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import TypeGuard

import numpy as np
import torch

from swarmdata.behavior_policies.exact_actor import MAX_WEIGHT, Actor, Layer, save_actor
from swarmdata.errors import BuildError
from swarmdata.interfaces import Policy
from swarmdata.learn.networks import perceptrons
from swarmdata.learn.policies.policy_file import load_policy
from swarmdata.learn.policies.torch_policy import TorchPolicy
from swarmdata.numerics.random import validation_seeds
from swarmdata.registry.components import make_env
from swarmdata.rollouts.side_env import AnyEnv, SideEnv
from swarmdata.specs.origins import SideSpec
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Double

MAX_SCALE = 20.0
"""Largest factor on a feature: 3 units, as in a wide arena, stay below the clip of 64."""


def export(source: Path, target: Path, n_agents: int) -> None:
    """Writes a run's policy as a checkpoint for exact inference, in a team of `n_agents`."""
    policy = load_policy(source)
    if not can_be_exact(policy):
        raise BuildError(
            f"{source} is not a perceptron without a memory that all robots share; only these can "
            "be run exactly. Train with mappo and parameters=shared."
        )
    export_actor(policy, target, n_agents)


def can_be_exact(policy: Policy) -> TypeGuard[TorchPolicy]:
    """Whether a policy is a perceptron that all robots share, as `exact_actor` computes it."""
    return (
        isinstance(policy, TorchPolicy)
        and policy.parameters == "shared"
        and all(layer.scale is None for layer in policy.layers)
    )


def export_actor(policy: TorchPolicy, target: Path, n_agents: int) -> None:
    """Writes a policy that `can_be_exact` as a checkpoint for exact inference.

    Raises:
        CheckpointError: its last weights are too large, or a layer is too wide.
    """
    layers = [
        (layer.weight[0].numpy().astype(np.float64), layer.bias[0, 0].numpy().astype(np.float64))
        for layer in policy.layers
    ]
    std = policy.observation_std
    mean, scale = policy.observation_mean.numpy(), 1 / torch.where(std < 1e-3, 1.0, std).numpy()
    # Inputs of exact inference are clipped at 64. Features that hardly varied when they were
    # measured are scaled less, by a power of two, and their weights more.
    fold = np.exp2(np.ceil(np.log2(np.maximum(scale / MAX_SCALE, 1.0))))
    largest = np.abs(layers[0][0][: len(fold)]).max(axis=1)  # weights are bounded too
    fold = np.minimum(fold, np.exp2(np.floor(np.log2(MAX_WEIGHT / np.maximum(largest, 1e-9)))))
    fold = np.maximum(fold, 1.0)
    layers[0][0][: len(fold)] *= fold[:, None]
    layers[0] = (_for_team(layers[0][0], len(mean), n_agents), layers[0][1])
    layers = scale_hidden_units(layers)
    save_actor(target, layers, mean, scale / fold, n_agents, policy.frame, squash=policy.squash)


def scale_hidden_units(layers: Sequence[Layer]) -> list[Layer]:
    """Returns the same function with smaller weights into hidden units whose weights are too large.

    The weights and the bias of a hidden unit are divided by a power of two, and the weights of the
    next layer that read the unit are multiplied by it: ReLU(c x) = c ReLU(x) for c > 0.
    """
    scaled = [(weight.copy(), bias.copy()) for weight, bias in layers]
    for layer, following in pairwise(scaled):
        largest = np.maximum(np.abs(layer[0]).max(axis=0), np.abs(layer[1]))
        factors = np.exp2(np.ceil(np.log2(np.maximum(largest / MAX_WEIGHT, 1.0))))
        np.divide(layer[0], factors, out=layer[0])
        np.divide(layer[1], factors, out=layer[1])
        np.multiply(following[0], factors[:, None], out=following[0])
    return scaled


def restored(actor: Actor, n_agents: int) -> TorchPolicy:
    """Returns a checkpoint's policy, with its rounded weights, to train `n_agents` from."""
    (weight, bias), *others = actor.layers
    layers = [(_for_team(weight, len(actor.mean), n_agents), bias), *others]
    return TorchPolicy(
        [
            perceptrons.Layer(torch.from_numpy(w[None]), torch.from_numpy(b[None, None]))
            for w, b in layers
        ],
        torch.from_numpy(actor.mean),
        torch.from_numpy(1 / actor.scale),
        squash=actor.squash,
        frame=actor.frame,
    )


def _for_team(weight: Double, n_features: int, n_agents: int) -> Double:
    """First weights for a team of another size: robot i gets the number i modulo the trained N."""
    of_features, of_numbers = weight[:n_features], weight[n_features:]
    return np.concatenate([of_features, of_numbers[np.arange(n_agents) % len(of_numbers)]])


def action_error(
    trained: Policy, exact: Policy, spec: TaskSpec | SideSpec, n_episodes: int
) -> float:
    """Returns the largest difference of an action of exact inference and of a trained network.

    Both get the observations of validation episodes that the exact policy plays; that of a side,
    against robots that do not move.
    """
    env: AnyEnv
    if isinstance(spec, SideSpec):
        env = SideEnv(make_env(spec.whole, n_episodes), spec, "idle")
    else:
        env = make_env(spec, n_episodes)
    step = env.reset(validation_seeds(n_episodes))
    worst = 0.0
    while not step.ended.all():
        actions = exact.act(step)
        difference = np.abs(trained.act(step) - actions)[~step.ended]
        worst = max(worst, float(difference.max()))
        step = env.step(actions)
    return worst
