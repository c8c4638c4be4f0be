"""JointFlow: a velocity field that carries noise to the joint actions of a dataset.

Conditional flow matching (Lipman et al. 2023, "Flow Matching for Generative Modeling") along
straight paths, as in rectified flow (Liu et al. 2023, "Flow Straight and Fast"). With the joint
action a, standard normal noise z of the same shape, a time t uniform in [0, 1], and
c = (state, all observations):

    x_t  = (1 - t) z + t a
    L(v) = 1/(N A) |v(c, x_t, t) - (a - z)|^2

A sample is the end at t = 1 of the path dx/dt = v(c, x, t) that begins at z, by Euler's method. So
the whole team's action is one function of z, and robots that must agree do.
"""

from collections.abc import Sequence

import torch
from torch import Tensor

from swarmdata.errors import SchemaError
from swarmdata.learn.networks.perceptrons import (
    MLPShape,
    StackedMLP,
    initialize,
    mlp_of_products,
)
from swarmdata.learn.networks.sizes import Sizes
from swarmdata.learn.products.stacked_products import affine, product

FLOW_STREAM = 4
"""Of a seed's initial parameters, beside those of `networks.actor` and `networks.factored_critics`.
"""


class JointFlow:
    """Velocity fields of K seeds.

    Args:
        sizes: numbers of agents and features.
        seeds: of the initial parameters, [K].
        hidden: sizes of the hidden layers, at least one.
        n_steps: of Euler's method.
        device: where the parameters are.

    Raises:
        SchemaError: there is no hidden layer, or no step.
    """

    def __init__(
        self,
        sizes: Sizes,
        seeds: Sequence[int],
        hidden: tuple[int, ...],
        n_steps: int,
        device: torch.device | str,
    ) -> None:
        if not hidden or n_steps < 1:
            raise SchemaError(
                f"a flow got hidden layers {hidden} and {n_steps} steps, expected at least one of "
                "each: without a hidden layer its velocity is linear, and all modes become one."
            )
        n_joint = sizes.n_agents * sizes.action
        shape = MLPShape(sizes.information + n_joint + 1, hidden, n_joint)
        self.network, self.n_steps = StackedMLP(shape, len(seeds), device), n_steps
        initialize(self.network, seeds, FLOW_STREAM)

    def loss(self, x: Tensor, actions: Tensor, noise: Tensor, times: Tensor) -> Tensor:
        """Returns L(v), the mean over rows, [K].

        Args:
            x: c, normalized states and observations, [K, B, S + N O].
            actions: of the data, [K, B, N, A].
            noise: z, standard normal, [K, B, N, A].
            times: t, uniform in [0, 1), [K, B, 1].
        """
        z, a = noise.flatten(2), actions.flatten(2)  # [K, B, N A]
        on_path = z + times * (a - z)
        velocities = self.network(torch.cat([x, on_path, times], 2))
        return (velocities - (a - z)).square().mean((1, 2))

    @torch.no_grad()
    def sample(self, x: Tensor, noise: Tensor) -> Tensor:
        """Returns the joint actions that noise leads to, [K, B, N, A], clipped to [-1, 1].

        Nothing is differentiated. What c adds to the first layer is computed once, not once for
        each step.

        Args:
            x: c, normalized states and observations, [K, B, S + N O].
            noise: z, standard normal, [K, B, N, A].
        """
        layers, n_known = self.network.constants(), x.shape[2]
        weight = layers[0].weight
        known = affine(x, weight[:, :n_known], layers[0].bias)
        moving, path = weight[:, n_known:-1], noise.flatten(2)
        for step in range(self.n_steps):
            now = weight[:, -1:] * (step / self.n_steps)
            products = product(path, moving).add_(known).add_(now)
            path = path + mlp_of_products(layers, products) / self.n_steps
        return path.clamp(-1, 1).view_as(noise)
