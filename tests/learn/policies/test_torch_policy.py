"""TorchPolicy computes what its networks answer to normalized observations."""

from itertools import pairwise

import numpy as np
import pytest
import torch
from torch import Tensor

from swarmdata.learn.networks.perceptrons import Layer
from swarmdata.learn.networks.team_networks import Parameters
from swarmdata.learn.policies.torch_policy import TorchPolicy, outputs_of

N_AGENTS, N_FEATURES = 3, 5


def policy(parameters: Parameters, hidden: tuple[int, ...], *, norm: bool = False) -> TorchPolicy:
    is_shared = parameters == "shared"
    sizes = (N_FEATURES + N_AGENTS * is_shared, *hidden, 2)
    generator = torch.Generator().manual_seed(len(hidden))
    n_rows = 1 if is_shared else N_AGENTS

    def draw(*shape: int) -> Tensor:
        return torch.randn(n_rows, *shape, generator=generator, dtype=torch.float64)

    layers = [
        Layer(draw(i, o), draw(1, o), *((draw(1, o), draw(1, o)) if norm and o != 2 else ()))
        for i, o in pairwise(sizes)
    ]
    std = draw(N_FEATURES)[0].abs()
    std[2] = 0.0  # a constant feature is only centered
    return TorchPolicy(layers, draw(N_FEATURES)[0], std, True, None, parameters=parameters)


@pytest.mark.parametrize("parameters", ["shared", "separate"])
@pytest.mark.parametrize("hidden", [(), (4,), (4, 6)])
@pytest.mark.parametrize("norm", [False, True])
def test_folded_networks_answer_as_the_layers_do(
    parameters: Parameters, hidden: tuple[int, ...], *, norm: bool
) -> None:
    acting = policy(parameters, hidden, norm=norm)
    observations = np.random.default_rng(0).standard_normal((7, N_AGENTS, N_FEATURES), np.float32)
    outputs = outputs_of(acting, observations)
    np.testing.assert_allclose(
        acting.actions(observations), outputs.tanh().numpy(), rtol=0, atol=6e-8
    )
