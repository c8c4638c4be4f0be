"""JointFlow: a velocity field that carries noise to the joint actions of a dataset.

Conditional flow matching (Lipman et al. 2023, "Flow Matching for Generative Modeling") along
straight paths, as in rectified flow (Liu et al. 2023, "Flow Straight and Fast"). With the joint
action a, standard normal noise z of the same shape, a time t uniform in [0, 1], and
c = (state, all observations):

    x_t     = (1 - t) z + t a
    L(e)    = 1/(N A) sum_i |e(c, o_i, i, x_t, x_t,i, t) - a_i|^2
    v_i     = (e(c, o_i, i, x, x_i, t) - x_i) / (1 - t)

A sample is the end at t = 1 of the path dx/dt = v(c, x, t) that begins at z, by Euler's method. All
robots share the network e. Every v_i is a function of the whole path x, so the team's action is one
function of z, and robots that must agree do.

The network predicts where a path ends, not its velocity a - z: the squared error of v at t counts
(1 - t)^2 times as much (Salimans & Ho 2022, "Progressive Distillation for Fast Sampling of
Diffusion Models", section 4; arXiv 2603.06454 for flows). A spread much smaller than the noise is
not copied.
"""

import torch
from torch import Tensor

from swarmdata.errors import SchemaError
from swarmdata.learn.networks.network_inputs import with_agent_id
from swarmdata.learn.networks.perceptrons import (
    Layer,
    MLPShape,
    StackedMLP,
    affine,
    initialize,
    mlp_of_branches,
    mlp_of_products,
)
from swarmdata.learn.networks.presence import acting, agent_mean
from swarmdata.learn.networks.setup import Setup

FLOW_STREAM = 4
"""Of a seed's initial parameters, beside those of `networks.actor` and `networks.factored_critics`.
"""


class JointFlow:
    """Velocity fields of K seeds, by networks that predict where a robot's part of a path ends."""

    def __init__(self, setup: Setup, hidden: tuple[int, ...], n_steps: int) -> None:
        if not hidden or n_steps < 1:
            raise SchemaError(
                f"a flow got hidden layers {hidden} and {n_steps} steps, expected at least one of "
                "each: without a hidden layer its velocity is linear, and all modes become one."
            )
        self.n_steps = n_steps
        self.sizes = sizes = setup.sizes
        self._n_team = sizes.information + sizes.n_agents * sizes.action + 1
        n_own = sizes.observation + sizes.n_agents + sizes.action
        shape = MLPShape(self._n_team + n_own, hidden, sizes.action)
        self.network = StackedMLP(shape, setup.n_seeds, setup.device)
        initialize(self.network, setup.seeds, FLOW_STREAM)

    def loss(
        self, x: Tensor, actions: Tensor, noise: Tensor, times: Tensor, alive: Tensor | None = None
    ) -> Tensor:
        """Returns L(e), the mean over rows, [K].

        x is c, normalized, [K, B, S + N O], actions the data's, [K, B, N, A]; the noise z is
        standard normal, [K, B, N, A], times t uniform in [0, 1), [K, B, 1]; `alive` is as in
        `presence`, [K, B, N].
        """
        on_path = noise + times[..., None] * (actions - noise)
        team = torch.cat([x, on_path.flatten(2), times], 2)
        own = torch.cat([self._own(x), on_path], 3)
        ends = mlp_of_branches(self.network.layers, team, own)
        return agent_mean((ends - actions).square(), alive)

    @torch.no_grad()
    def sample(self, x: Tensor, noise: Tensor, alive: Tensor | None = None) -> Tensor:
        """Returns the joint actions that noise leads to, [K, B, N, A], in [-1, 1]; no gradient.

        `x` is c, normalized, [K, B, S + N O], `noise` z, standard normal, [K, B, N, A]; paths of
        robots that are not `alive` end at 0, as in the data. What c adds to the first layer is
        computed once, not once for each step.
        """
        layers = self.network.constants()
        known, moving = self._first_products(layers[0], x)
        clock, path = layers[0].weight[:, self._n_team - 1 : self._n_team], noise.flatten(2)
        for step in range(self.n_steps):
            products = torch.baddbmm(known, path, moving).view(len(path), -1, clock.shape[2])
            products.add_(clock * (step / self.n_steps))
            ends = acting(mlp_of_products(layers, products).view_as(noise), alive)
            path = path + (ends.flatten(2) - path) / (self.n_steps - step)
        return path.clamp(-1, 1).view_as(noise)

    def _first_products(self, first: Layer, x: Tensor) -> tuple[Tensor, Tensor]:
        """What c adds to a first layer's products, [K, B, N H], and a path's map, [K, N A, N H]."""
        n_agents, n_actions = self.sizes.n_agents, self.sizes.action
        team, own = first.weight[:, : self._n_team], first.weight[:, self._n_team :]
        of_team = affine(x, team[:, : x.shape[2]], first.bias).repeat(1, 1, n_agents)
        of_own = torch.bmm(self._own(x).flatten(1, 2), own[:, :-n_actions]).view_as(of_team)
        identity = torch.eye(n_agents, device=x.device)
        own_part = torch.einsum("ij,kah->kiajh", identity, own[:, -n_actions:])
        team_part = team[:, x.shape[2] : -1].repeat(1, 1, n_agents)
        return of_team + of_own, team_part + own_part.reshape(team_part.shape)

    def _own(self, x: Tensor) -> Tensor:
        """Returns each robot's observation and number, [K, B, N, O + N]."""
        observations = x[..., self.sizes.state :].reshape(*x.shape[:2], self.sizes.n_agents, -1)
        return with_agent_id(observations)
