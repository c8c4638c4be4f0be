"""Where the robots of an intersection start."""

import numpy as np
import pytest

from swarmdata.envs.intersection.intersection import START_JITTER, Intersection, StartPlan
from swarmdata.envs.intersection.junction import Junction, arm_at
from swarmdata.errors import SpecError
from swarmdata.numerics.geometry import clearance
from swarmdata.registry.presets import preset
from swarmdata.specs.state_layout import N_COLUMNS, Y, robots_of

IDS = np.arange(2**62, 2**62 + 100, dtype=np.uint64)


@pytest.mark.parametrize(("name", "n"), [("intersection", 4), ("intersection-n8", 8)])
def test_robots_start_clear_of_all_and_as_many_in_each_arm(name: str, n: int) -> None:
    spec = preset(name)
    task = Intersection(spec)
    states = np.ones((100, N_COLUMNS * n + 3 * n), np.float32)
    task.spawn(IDS, np.arange(100), np.zeros((100, 4, 8), np.float32), states)
    half, first_arms = np.array(spec.half_size), set()
    for robots in robots_of(states, n).astype(np.float64):
        arms = [arm_at(*robot[: Y + 1]) for robot in robots]
        assert np.bincount(arms, minlength=4).tolist() == [n // 4] * 4
        first_arms.add(arms[0])
        apart = np.linalg.norm(robots[:, None, : Y + 1] - robots[:, : Y + 1], axis=-1)
        assert (apart[~np.eye(n, dtype=bool)] >= 2 * 0.12 + 0.05).all()
        assert all(clearance(*r[: Y + 1], task.junction.corners, half) >= 0.13 for r in robots)
        assert not robots[:, 2:4].any()
    assert first_arms == {0, 1, 2, 3}


def test_the_first_robot_of_an_arm_is_in_its_entry_and_the_third_behind_its_exit() -> None:
    spec = preset("intersection").with_updates(team=[{"count": 9}])
    junction = Junction.of(spec)
    plan = StartPlan.of(spec, junction)
    assert plan.places.shape == (4, 3, 2)
    np.testing.assert_allclose(plan.places[:, 0], junction.entries)
    np.testing.assert_allclose(plan.places[:, 1], junction.exits)
    behind = np.linalg.norm(junction.exits - plan.places[:, 2], axis=-1)
    np.testing.assert_allclose(behind, 0.24 + spec.spawn.start_separation + 2 * START_JITTER)


def test_more_robots_than_the_arms_hold_are_refused() -> None:
    spec = preset("intersection").with_updates(team=[{"count": 24}])
    with pytest.raises(SpecError, match=r"6 robots with gaps of 0\.21 m do not fit in an arm"):
        Intersection(spec)
