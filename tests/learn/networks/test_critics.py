"""Joint critics: twins apart, parameters that the policies' loss cannot move, slow copies."""

import pytest
import torch
from torch import Tensor

from swarmdata.learn.networks.critics import Critics
from swarmdata.learn.networks.setup import Sizes

SIZES = Sizes(n_agents=3, observation=2, action=2, state=4)


def made(n_seeds: int = 2, n_critics: int = 2) -> Critics:
    return Critics(
        SIZES.information + 3 * 2, range(n_seeds), (8,), learning_rate=1e-2, max_norm=None,
        n_critics=n_critics,
    )  # fmt: skip


def inputs(n_seeds: int = 2, size: int = 5) -> tuple[Tensor, Tensor, Tensor]:
    """What critics see, and two joint actions."""
    g = torch.Generator().manual_seed(0)
    x = torch.randn(n_seeds, size, 4 + 3 * 2, generator=g)
    one, other = (torch.rand(n_seeds, size, 3, 2, generator=g) for _ in range(2))
    return x, one, other


@pytest.mark.parametrize("n_critics", [1, 2, 4])
def test_values_have_an_axis_of_critics(n_critics: int) -> None:
    critics = made(2, n_critics)
    x, actions, _ = inputs()
    q = critics.q(x, actions)
    assert q.shape == (2, n_critics, 5, 1)
    for seed in range(2):
        for critic in range(n_critics):  # row by row, by hand
            rows = torch.cat([x[seed], actions[seed].flatten(1)], 1)
            alone = critics.online(rows.expand(len(critics.online.flat), -1, -1))
            torch.testing.assert_close(q[seed, critic], alone[n_critics * seed + critic])


def test_twins_begin_apart_and_each_follows_its_own_error() -> None:
    critics = made()
    x, actions, _ = inputs()
    before = critics.online.flat.clone()
    assert len({tuple(row.tolist()) for row in before}) == 4
    loss = critics.q(x, actions)[..., 0]
    critics.step(loss[:, 0].square().mean(1))  # of the first critics only
    moved = (critics.online.flat != before).any(1)
    assert moved.tolist() == [True, False, True, False]


def test_first_values_are_those_of_the_first_critics_and_cannot_move_them() -> None:
    critics = made()
    x, pi, _ = inputs()
    pi.requires_grad_()
    q = critics.first_q(x, pi)
    torch.testing.assert_close(q, critics.q(x, pi)[:, 0])
    (gradient,) = torch.autograd.grad(q.sum(), pi)
    assert gradient.abs().sum() > 0
    leaves = [w for layer in critics.online.layers for w in layer if w is not None]
    unused = torch.autograd.grad(critics.first_q(x, pi).sum(), leaves, allow_unused=True)
    assert all(gradient is None for gradient in unused)


def test_values_of_samples_are_those_of_single_actions() -> None:
    critics = made()
    g = torch.Generator().manual_seed(1)
    x, samples = torch.randn(2, 5, 10, generator=g), torch.rand(2, 5, 4, 3, 2, generator=g)
    got, first = critics.sampled_q(x, samples), critics.first_sampled_q(x, samples)
    assert got.shape == (2, 2, 5, 4, 1)
    for sample in range(4):
        expected = critics.q(x, samples[:, :, sample])
        torch.testing.assert_close(got[:, :, :, sample], expected)
        torch.testing.assert_close(first[:, :, sample], expected[:, 0])
    assert got.requires_grad
    assert not first.requires_grad
