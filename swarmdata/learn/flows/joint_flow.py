"""JointFlow: a velocity field that carries noise to the joint actions of a dataset.

Conditional flow matching (Lipman et al. 2023, "Flow Matching for Generative Modeling") along
straight paths, as in rectified flow (Liu et al. 2023, "Flow Straight and Fast"). With the joint
action a, standard normal noise z of the same shape, a time t uniform in [0, 1], and
c = (state, all observations):

    x_t  = (1 - t) z + t a
    L(e) = 1/(N A) |e(c, x_t, t) - a|^2
    v(c, x, t) = (e(c, x, t) - x) / (1 - t)

A sample is the end at t = 1 of the path dx/dt = v(c, x, t) that begins at z, by Euler's method. So
the whole team's action is one function of z, and robots that must agree do.

The network e predicts where a path ends, not its velocity a - z. The best field is the same; the
squared error of v at t counts (1 - t)^2 times as much (Salimans & Ho 2022, "Progressive
Distillation for Fast Sampling of Diffusion Models", section 4, compare such outputs for diffusion,
and arXiv 2603.06454 for flows). Where c tells nearly all of the action, as it does in the data of
experts, e hardly depends on x, and the last step ends at e itself, where a velocity must cancel the
noise in its input ever more exactly.

The price is that a spread much smaller than the noise is not copied: it shows in x at late times
only, where e gains little by it. Modes far apart stay apart.
"""

from collections.abc import Sequence

import torch
from torch import Tensor

from swarmdata.errors import SchemaError
from swarmdata.learn.networks.perceptrons import (
    MLPShape,
    StackedMLP,
    affine,
    initialize,
    mlp_of_products,
)
from swarmdata.learn.networks.sizes import Sizes

FLOW_STREAM = 4
"""Of a seed's initial parameters, beside those of `networks.actor` and `networks.factored_critics`.
"""


class JointFlow:
    """Velocity fields of K seeds, by networks that predict where paths end.

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
        """Returns L(e), the mean over rows, [K].

        Args:
            x: c, normalized states and observations, [K, B, S + N O].
            actions: of the data, [K, B, N, A].
            noise: z, standard normal, [K, B, N, A].
            times: t, uniform in [0, 1), [K, B, 1].
        """
        z, a = noise.flatten(2), actions.flatten(2)  # [K, B, N A]
        on_path = z + times * (a - z)
        ends = self.network(torch.cat([x, on_path, times], 2))
        return (ends - a).square().mean((1, 2))

    @torch.no_grad()
    def mean(self, x: Tensor, noise: Tensor) -> Tensor:
        """Returns the mean of the data's joint actions given c, [K, B, N, A].

        At t = 0 a path is at its noise, which tells nothing of its end: e predicts the mean there.

        Args:
            x: c, normalized states and observations, [K, B, S + N O].
            noise: z, standard normal, [K, B, N, A].
        """
        start = noise.flatten(2)
        ends = self.network(torch.cat([x, start, start.new_zeros(*start.shape[:2], 1)], 2))
        return ends.view_as(noise)

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
            products = torch.bmm(path, moving).add_(known).add_(now)
            path = path + (mlp_of_products(layers, products) - path) / (self.n_steps - step)
        return path.clamp(-1, 1).view_as(noise)
