"""Right and left of oncoming robots are as drivers mean it."""

import numpy as np
import pytest

pytest.importorskip("torch", reason="online algorithms need the torch extra")

from swarmdata.online_algos.shaping.passing_side import oncoming
from swarmdata.registry.components import make_env
from swarmdata.specs.task_spec import TaskSpec

Sides = tuple[list[float], list[float]]


def meeting(offset: float, speed: float = 0.5, angle: float = 0.0, gap: float = 0.8) -> Sides:
    """Who robots 0 and 1 have on their right and left; 0 drives along x, sees 1 at an offset."""
    step = make_env(TaskSpec(), 1).reset(np.zeros(1, np.uint64))
    robots = np.zeros((4, 8))
    robots[2:, :2] = [[1.5, 1.5], [-1.5, -1.5]]
    robots[1, :2] = gap, offset
    robots[0, 2], robots[1, 2] = speed, -speed
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, -s], [s, c]])
    robots[:, :2], robots[:, 2:4] = robots[:, :2] @ turn.T, robots[:, 2:4] @ turn.T
    right, left = oncoming(step._replace(states=robots.reshape(1, -1).astype(np.float32)))
    assert (right[0, 2:] + left[0, 2:] == 0).all()
    return list(right[0, :2]), list(left[0, :2])


@pytest.mark.parametrize("angle", [0.0, 1.0, 2.5, -2.0])
def test_both_have_the_other_on_the_same_side(angle: float) -> None:
    assert meeting(-0.2, angle=angle) == ([1, 1], [0, 0])
    assert meeting(0.2, angle=angle) == ([0, 0], [1, 1])


def test_robots_that_stand_have_passed_or_are_far_away_do_not_meet() -> None:
    nobody: Sides = ([0, 0], [0, 0])
    assert meeting(-0.2, speed=0.05) == nobody
    assert meeting(-0.2, speed=-0.5) == nobody
    assert meeting(-0.2, gap=1.2) == nobody
