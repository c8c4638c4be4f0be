"""Right and left of oncoming robots are as drivers mean it."""

import numpy as np
import pytest

pytest.importorskip("torch", reason="online algorithms need the torch extra")

from swarmdata.online_algos.shaping.shaped_env import PassingSide, count_oncoming
from swarmdata.registry.components import make_env
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Step

Sides = tuple[list[float], list[float]]


def meeting_step(offset: float, speed: float, angle: float, gap: float) -> Step:
    """Robot 0 drives along x, robot 1 comes towards it at an offset; all is turned by an angle."""
    step = make_env(TaskSpec(), 1).reset(np.zeros(1, np.uint64))
    robots = np.zeros((4, 8))
    robots[2:, :2] = [[1.5, 1.5], [-1.5, -1.5]]
    robots[1, :2] = gap, offset
    robots[0, 2], robots[1, 2] = speed, -speed
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, -s], [s, c]])
    robots[:, :2], robots[:, 2:4] = robots[:, :2] @ turn.T, robots[:, 2:4] @ turn.T
    return step._replace(states=robots.reshape(1, -1).astype(np.float32))


def meeting(offset: float, speed: float = 0.5, angle: float = 0.0, gap: float = 0.8) -> Sides:
    """How many oncoming robots robots 0 and 1 have on their right and left."""
    right, left = count_oncoming(meeting_step(offset, speed, angle, gap))
    assert (right[0, 2:] + left[0, 2:] == 0).all()
    return list(right[0, :2]), list(left[0, :2])


@pytest.mark.parametrize(("offset", "cost"), [(-0.2, 0.5), (0.2, 0.25)])
def test_each_side_has_its_cost(offset: float, cost: float) -> None:
    step = meeting_step(offset, 0.5, 0.0, 0.8)
    rewards = np.ones((1, 4), np.float32)
    changed = PassingSide(0.5, 0.25).apply(rewards, step, step, 0.0)
    np.testing.assert_array_equal(changed, [[1 - cost, 1 - cost, 1, 1]])
    assert changed.dtype == np.float32


@pytest.mark.parametrize("angle", [0.0, 1.0, 2.5, -2.0])
def test_both_have_the_other_on_the_same_side(angle: float) -> None:
    assert meeting(-0.2, angle=angle) == ([1, 1], [0, 0])
    assert meeting(0.2, angle=angle) == ([0, 0], [1, 1])


def test_robots_that_stand_have_passed_or_are_far_away_do_not_meet() -> None:
    nobody: Sides = ([0, 0], [0, 0])
    assert meeting(-0.2, speed=0.05) == nobody
    assert meeting(-0.2, speed=-0.5) == nobody
    assert meeting(-0.2, gap=1.2) == nobody
