"""Keeping to the right is measured as drivers mean it."""

import numpy as np
import pytest

pytest.importorskip("torch", reason="online algorithms need the torch extra")

from swarmdata.online_algos.conventions import on_the_wrong_side
from swarmdata.registry import make_env
from swarmdata.spec import TaskSpec


def meeting(offset: float, speed: float = 0.5, angle: float = 0.0, gap: float = 0.8) -> list[float]:
    """Costs of robots 0 and 1, which meet; robot 0 drives along x and sees 1 at this offset."""
    step = make_env(TaskSpec(), 1).reset(np.zeros(1, np.uint64))
    robots = np.zeros((4, 8))
    robots[2:, :2] = [[1.5, 1.5], [-1.5, -1.5]]
    robots[1, :2] = gap, offset
    robots[0, 2], robots[1, 2] = speed, -speed
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, -s], [s, c]])
    robots[:, :2], robots[:, 2:4] = robots[:, :2] @ turn.T, robots[:, 2:4] @ turn.T
    costs = on_the_wrong_side(step._replace(states=robots.reshape(1, -1).astype(np.float32)))
    assert (costs[0, 2:] == 0).all()
    return list(costs[0, :2])


@pytest.mark.parametrize("angle", [0.0, 1.0, 2.5, -2.0])
def test_both_pay_while_each_has_the_other_on_its_right(angle: float) -> None:
    assert meeting(-0.2, angle=angle) == [1, 1]
    assert meeting(0.2, angle=angle) == [0, 0]


def test_robots_that_stand_have_passed_or_are_far_away_pay_nothing() -> None:
    assert meeting(-0.2, speed=0.05) == [0, 0]
    assert meeting(-0.2, speed=-0.5) == [0, 0]
    assert meeting(-0.2, gap=1.2) == [0, 0]
