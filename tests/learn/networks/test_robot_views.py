"""What critics of robots see: everything in one frame, and each robot first."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import Tensor

from swarmdata.learn.networks.critics import Critic, RobotCritics, RobotViews
from swarmdata.learn.networks.network_inputs import Normalizer
from swarmdata.learn.networks.setup import Sizes
from swarmdata.perception.frames import Frame
from swarmdata.types import Double
from tests.offline_algos.toys import SIZES as TOYS
from tests.offline_algos.toys import random_batch, statistics

FRAME = Frame(anchor=0, vectors=(0, 2), closing=())
RAW, N = 5, 3  # two vectors and a number; robots
SIZES = Sizes(
    N, RAW + FRAME.n_added, 3, state=N * 4 + 3,
    frame=FRAME, robot_columns=4, state_vectors=(0, 2, 4, 6, 8, 10, 12),
)  # fmt: skip
MOMENTS = replace(
    statistics(),
    observation_mean=np.zeros(SIZES.observation),
    observation_std=np.ones(SIZES.observation),
    state_mean=np.zeros(SIZES.state),
    state_std=np.ones(SIZES.state),
)


def turned(vectors: Double, angle: float) -> Double:
    """Vectors [..., 2 V] turned by an angle."""
    pairs = vectors.reshape(*vectors.shape[:-1], -1, 2)
    c, s = np.cos(angle), np.sin(angle)
    x, y = pairs[..., 0], pairs[..., 1]
    return np.stack([c * x - s * y, s * x + c * y], -1).reshape(vectors.shape)


def world(angle: float = 0.0) -> tuple[Tensor, Tensor, Tensor]:
    """States, observations and actions of the same rows with the world turned by an angle."""
    rng = np.random.default_rng(0)
    states, actions = rng.normal(size=(6, SIZES.state)), rng.uniform(-0.5, 0.5, (6, N, 3))
    observations = rng.normal(size=(6, N, RAW))
    states[:, :14] = turned(states[:, :14], angle)
    observations[..., :4] = turned(observations[..., :4], angle)
    actions[..., :2] = turned(actions[..., :2], angle)
    seen = observations.astype(np.float32)
    local = FRAME.to_local(seen, actions)
    arrays = (states, FRAME.inputs(seen), local)
    s, o, a = (torch.from_numpy(array.astype(np.float32))[None] for array in arrays)
    return s, o, a


def views(critic: Critic) -> RobotViews:
    return RobotViews(SIZES, Normalizer(MOMENTS, "cpu"), critic, "cpu")


def seen(critic: Critic, states: Tensor, observations: Tensor, actions: Tensor) -> Tensor:
    made = views(critic)
    view = made.view(states, observations)
    assert view.features.shape[-1] == made.n_features
    joint = made.actions(view, actions, actions)
    assert joint.shape[-1] == made.n_actions
    return torch.cat([view.rows, joint], -1)


@pytest.mark.parametrize("critic", ["centralized", "decentralized"])
@pytest.mark.parametrize("angle", [0.7, -2.0, np.pi])
def test_nothing_changes_when_the_world_is_turned(critic: Critic, angle: float) -> None:
    """But for the axis of the frame in the world, which policies see too."""
    axis = slice(RAW, RAW + 2)
    ours, theirs = seen(critic, *world()), seen(critic, *world(angle))
    assert not torch.allclose(ours[..., axis], theirs[..., axis])
    ours[..., axis] = theirs[..., axis] = 0
    torch.testing.assert_close(ours, theirs, atol=2e-5, rtol=1e-5)


def test_actions_of_others_are_in_the_robots_own_frame() -> None:
    states, observations, local = world()
    made = views("centralized")
    view = made.view(states, observations)
    joint = made.actions(view, local, local).view(1, 6, N, N, 3)
    torch.testing.assert_close(joint[:, :, :, 0], local)  # slot 0 is the robot itself
    ux, uy = observations[..., RAW], observations[..., RAW + 1]
    for robot, slot in ((0, 1), (2, 1), (1, 2)):
        other = (robot + slot) % N
        x, y = local[:, :, other, 0], local[:, :, other, 1]
        wx = ux[:, :, other] * x - uy[:, :, other] * y  # in the world
        wy = uy[:, :, other] * x + ux[:, :, other] * y
        ahead = ux[:, :, robot] * wx + uy[:, :, robot] * wy
        torch.testing.assert_close(joint[:, :, robot, slot, 0], ahead, atol=1e-5, rtol=1e-5)
        torch.testing.assert_close(joint[:, :, robot, slot, 2], local[:, :, other, 2])


def test_a_turn_rate_is_a_number_and_a_speed_a_vector_along_the_heading() -> None:
    """Robot 1 is holonomic, the others are unicycles."""
    states, observations, local = world()
    frame = Frame(anchor=0, vectors=(0, 2), closing=(), heading=2, holonomic=(1,))
    made = RobotViews(replace(SIZES, frame=frame), Normalizer(MOMENTS, "cpu"), "centralized", "cpu")
    joint = made.actions(made.view(states, observations), local, local)
    assert joint.shape[-1] == made.n_actions
    joint = joint.view(1, 6, N, N, 4)
    x, y = (observations[..., RAW + k] for k in (0, 1))  # of the frames in the world
    for robot, slot in ((0, 0), (0, 1), (0, 2), (1, 1), (2, 1), (2, 2)):
        other = (robot + slot) % N
        ahead, left, turn_rate, rest = joint[:, :, robot, slot].unbind(-1)
        first, second, third = local[:, :, other].unbind(-1)
        torch.testing.assert_close(turn_rate, second if other != 1 else torch.zeros_like(second))
        torch.testing.assert_close(rest, third)
        sideways = second if other == 1 else 0.0
        cos = x[:, :, robot] * x[:, :, other] + y[:, :, robot] * y[:, :, other]
        sin = x[:, :, robot] * y[:, :, other] - y[:, :, robot] * x[:, :, other]
        torch.testing.assert_close(ahead, cos * first - sin * sideways, atol=1e-5, rtol=1e-5)
        torch.testing.assert_close(left, sin * first + cos * sideways, atol=1e-5, rtol=1e-5)


def test_only_what_the_others_do_may_be_taken_from_elsewhere() -> None:
    states, observations, local = world()
    made = views("centralized")
    view = made.view(states, observations)
    mixed = made.actions(view, local, torch.zeros_like(local)).view(1, 6, N, N, 3)
    torch.testing.assert_close(mixed[:, :, :, 0], local)
    assert not mixed[:, :, :, 1:].any()


def test_robots_of_the_state_come_in_the_order_of_the_actions() -> None:
    still = replace(SIZES, frame=None, observation=RAW)
    moments = replace(MOMENTS, observation_mean=np.zeros(RAW), observation_std=np.ones(RAW))
    made = RobotViews(still, Normalizer(moments, "cpu"), "centralized", "cpu")
    states = torch.arange(SIZES.state, dtype=torch.float32)[None, None]
    view = made.view(states, torch.zeros(1, 1, N, RAW))
    of_one = view.features[0, 0, 1, RAW + N :]
    expected = [4, 5, 6, 7, 8, 9, 10, 11, 0, 1, 2, 3, 12, 13, 14]
    assert of_one.tolist() == [float(k) for k in expected]


@pytest.mark.parametrize("critic", ["centralized", "decentralized"])
def test_values_of_candidates_are_those_of_single_deviations(critic: Critic) -> None:
    states, observations, local = world()
    normalizer = Normalizer(MOMENTS, "cpu")
    critics = RobotCritics(SIZES, normalizer, critic, [0], (8,), learning_rate=1e-3, max_norm=None)
    view = critics.view(states, observations)
    candidates = torch.stack([local, -local, local / 2], 3)
    values = critics.candidate_q(view, candidates, local)
    for m in range(3):
        for robot in range(N):
            joint = local.clone()
            joint[:, :, robot] = candidates[:, :, robot, m]
            expected = critics.q(view, joint).amin(1)[..., robot]
            torch.testing.assert_close(values[..., robot, m], expected)
    torch.testing.assert_close(critics.smallest_q(view, local, local), values[..., 0])
    torch.testing.assert_close(critics.first_q(view, local, local), critics.q(view, local)[:, 0])


CRITICS: tuple[Critic, ...] = ("centralized", "decentralized")


def toy_critics(critic: Critic) -> RobotCritics:
    normalizer = Normalizer(statistics(), "cpu")
    return RobotCritics(TOYS, normalizer, critic, [0, 1], (8,), learning_rate=1e-3, max_norm=None)


@pytest.mark.parametrize("critic", CRITICS)
def test_sampled_values_are_those_of_single_joint_actions(critic: Critic) -> None:
    critics, batch = toy_critics(critic), random_batch(2, 5)
    view = critics.view(batch.states, batch.observations)
    joint = torch.rand(2, 5, 3, 2, 2)
    values = critics.sampled_q(view, joint, joint)
    assert values.shape == (2, 2, 5, 2, 3)
    for sample in range(3):
        torch.testing.assert_close(values[..., sample], critics.q(view, joint[:, :, sample]))


@pytest.mark.parametrize("critic", CRITICS)
def test_one_robot_leaves_while_the_others_stay(critic: Critic) -> None:
    critics, batch = toy_critics(critic), random_batch(2, 5)
    view = critics.view(batch.states, batch.observations)
    own = torch.rand(2, 5, 1, 2, 2)
    values = critics.sampled_q(view, own, batch.actions[:, :, None])
    for robot in range(2):
        joint = batch.actions.clone()
        joint[:, :, robot] = own[:, :, 0, robot]
        alone = critics.q(view, joint)[..., robot]
        torch.testing.assert_close(values[..., robot, 0], alone)
        slow = critics.target_q(view, own[:, :, 0], batch.actions)[..., robot]
        torch.testing.assert_close(slow, alone)  # the slow copies begin alike
