"""Joint flows: the written loss, Euler's method, and what a robot's part depends on."""

import pytest
import torch
from torch import Tensor

from swarmdata.errors import SchemaError
from swarmdata.learn.flows.joint_flow import JointFlow
from swarmdata.learn.networks.setup import Setup
from tests.offline_algos.toys import SIZES, statistics

K, B = 2, 5
SETUP = Setup(SIZES, range(K), statistics())


def made(n_steps: int = 3) -> JointFlow:
    return JointFlow(SETUP, (8, 8), n_steps)


def drawn(*shape: int, seed: int = 0) -> Tensor:
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed))


def ends(flow: JointFlow, x: Tensor, path: Tensor, times: Tensor) -> Tensor:
    """What the network says of each robot, one after the other, [K, B, N, A]."""
    team = torch.cat([x, path.flatten(2), times], 2)
    parts = []
    for robot in range(2):
        number = torch.zeros(K, B, 2)
        number[..., robot] = 1
        own = x[..., 4 + 3 * robot : 7 + 3 * robot]
        parts.append(flow.network(torch.cat([team, own, number, path[:, :, robot]], 2)))
    return torch.stack(parts, 2)


def test_the_loss_is_of_the_ends_of_straight_paths() -> None:
    flow, x, z = made(), drawn(K, B, SIZES.information), drawn(K, B, 2, 2, seed=1)
    a, t = drawn(K, B, 2, 2, seed=2), torch.rand(K, B, 1)
    on_path = (1 - t)[..., None] * z + t[..., None] * a
    expected = (ends(flow, x, on_path, t) - a).square().mean((1, 2, 3))
    torch.testing.assert_close(flow.loss(x, a, z, t), expected)


def test_a_sample_is_what_eulers_method_reaches() -> None:
    flow, x, z = made(n_steps=4), drawn(K, B, SIZES.information), drawn(K, B, 2, 2, seed=1)
    path = z
    for step in range(4):
        time = step / 4
        end = ends(flow, x, path, torch.full((K, B, 1), time)).detach()
        path = path + (end - path) / (1 - time) / 4
    sample = flow.sample(x, z)
    torch.testing.assert_close(sample, path.clamp(-1, 1))
    assert not sample.requires_grad
    assert torch.equal(z, drawn(K, B, 2, 2, seed=1))  # the noise is not written to


def test_a_robot_that_has_left_does_not_move_the_others() -> None:
    """Nobody teaches the network where such a robot's path ends; in training it ended at 0."""
    flow, x, z = made(), drawn(K, B, SIZES.information), drawn(K, B, 2, 2, seed=1)
    alive = torch.tensor([True, False]).expand(K, B, 2)
    before = flow.sample(x, z, alive)
    with torch.no_grad():
        flow.network.layers[0].weight[:, -3] += 5.0  # of the input that is 1 for the second robot
    torch.testing.assert_close(flow.sample(x, z, alive), before)
    assert not before[:, :, 1].any()


def test_samples_stay_in_range() -> None:
    flow = made()
    with torch.no_grad():
        flow.network.layers[-1].weight.mul_(20.0)
    assert flow.sample(drawn(K, 50, SIZES.information), drawn(K, 50, 2, 2)).abs().max() == 1


@pytest.mark.parametrize(("hidden", "n_steps"), [((), 3), ((8,), 0)])
def test_a_flow_needs_a_hidden_layer_and_a_step(hidden: tuple[int, ...], n_steps: int) -> None:
    with pytest.raises(SchemaError, match="at least one of each"):
        JointFlow(SETUP, hidden, n_steps)
