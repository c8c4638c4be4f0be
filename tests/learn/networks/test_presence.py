"""Means over agents that act."""

import torch

from swarmdata.learn.networks.presence import acting, agent_mean

ERRORS = torch.arange(12.0).view(1, 3, 2, 2)
ALIVE = torch.tensor([[[True, True], [True, False], [False, False]]])


def test_means_leave_out_agents_that_have_left() -> None:
    assert agent_mean(ERRORS, ALIVE).tolist() == [ERRORS.flatten()[:6].mean().item()]
    assert agent_mean(ERRORS.sum(3), ALIVE).tolist() == [5.0]
    torch.testing.assert_close(agent_mean(ERRORS, None), ERRORS.mean((1, 2, 3)))
    assert agent_mean(ERRORS, torch.zeros_like(ALIVE)).tolist() == [0.0]


def test_errors_of_agents_that_have_left_have_no_gradient() -> None:
    values = ERRORS.clone().requires_grad_()
    actions = acting(values, ALIVE)
    (gradient,) = torch.autograd.grad(actions.square().sum(), values)
    assert (actions[~ALIVE] == 0).all()
    assert (gradient[~ALIVE] == 0).all()
    torch.testing.assert_close(gradient[ALIVE], 2 * values[ALIVE])
    assert acting(values, None) is values
