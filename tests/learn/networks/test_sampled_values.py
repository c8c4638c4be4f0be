"""Values of several actions of each robot, and of actions that the others do not take part in."""

import pytest

torch = pytest.importorskip("torch", reason="algorithms need torch")

from swarmdata.learn.networks.normalizer import Normalizer  # noqa: E402
from swarmdata.learn.networks.robot_critics import RobotCritics  # noqa: E402
from swarmdata.learn.networks.robot_views import Critic  # noqa: E402
from tests.offline_algos.toys import SIZES, random_batch, statistics  # noqa: E402

KINDS: tuple[Critic, ...] = ("centralized", "decentralized")


def made(critic: Critic) -> RobotCritics:
    normalizer = Normalizer(statistics(), "cpu")
    return RobotCritics(SIZES, normalizer, critic, [0, 1], (8,), learning_rate=1e-3, max_norm=None)


@pytest.mark.parametrize("critic", KINDS)
def test_sampled_values_are_those_of_single_joint_actions(critic: Critic) -> None:
    critics, batch = made(critic), random_batch(2, 5)
    view = critics.view(batch.states, batch.observations)
    joint = torch.rand(2, 5, 3, 2, 2)
    values = critics.sampled_q(view, joint, joint)
    assert values.shape == (2, 2, 5, 2, 3)
    for sample in range(3):
        torch.testing.assert_close(values[..., sample], critics.q(view, joint[:, :, sample]))


@pytest.mark.parametrize("critic", KINDS)
def test_one_robot_leaves_while_the_others_stay(critic: Critic) -> None:
    critics, batch = made(critic), random_batch(2, 5)
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
