"""Deadlocks, counted by hand."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from swarmdata.envs.world.deadlocks import count_deadlocks, locked_pairs
from swarmdata.types import Double

DT = 0.1


def line(*x: float, n_steps: int) -> Double:
    """Robots that stand at (x, 0) for so many steps, [n_steps, N, 2]."""
    rows = np.stack([np.array(x), np.zeros(len(x))], axis=-1)
    return np.repeat(rows[None], n_steps, axis=0)


def drive(start: Double, to: Double, n_steps: int) -> Double:
    """From one row of robots to another at constant speed."""
    part = np.linspace(0.0, 1.0, n_steps + 1)[1:, None, None]
    return start + part * (to - start)


def count(positions: Double, radius: float = 0.1) -> int:
    return count_deadlocks(positions, np.full(positions.shape[1], radius), DT)


def test_two_that_stand_near_each_other_for_three_seconds_are_one_deadlock() -> None:
    assert count(line(0.0, 0.4, n_steps=30)) == 0  # 29 steps are 2.9 s
    assert count(line(0.0, 0.4, n_steps=31)) == 1
    assert count(line(0.0, 0.4, n_steps=200)) == 1
    assert count(line(0.0, 0.51, n_steps=200)) == 0  # a gap of 0.31 m


def test_a_group_counts_once_and_two_groups_twice() -> None:
    assert count(line(0.0, 0.4, 0.8, n_steps=60)) == 1  # the outer ones are locked by the middle
    assert count(line(0.0, 0.4, 3.0, 3.4, n_steps=60)) == 2


def test_one_that_joins_does_not_count_again() -> None:
    first = line(0.0, 0.4, 3.0, n_steps=60)
    joins = drive(first[-1], line(0.0, 0.4, 0.8, n_steps=1)[0], 30)
    stays = line(0.0, 0.4, 0.8, n_steps=60)
    assert count(np.concatenate([first, joins, stays])) == 1


def test_a_deadlock_that_forms_again_counts_again() -> None:
    jam, apart = line(0.0, 0.4, n_steps=60), line(0.0, 2.0, n_steps=1)[0]
    away, back = drive(jam[-1], apart, 30), drive(apart, jam[0], 30)
    assert count(np.concatenate([jam, away, back, jam])) == 2


def test_a_short_episode_and_a_single_robot_have_none() -> None:
    assert count(line(0.0, 0.4, n_steps=5)) == 0
    assert count(line(0.0, n_steps=200)) == 0


@given(st.integers(0, 2**32 - 1), st.integers(1, 5), st.sampled_from([0.05, 0.1, 0.25]))
def test_locked_pairs_are_what_the_definition_says(seed: int, n: int, dt: float) -> None:
    rng = np.random.default_rng(seed)
    still = rng.random((120, n, 1)) < 0.97  # long stands, now and then a jump
    steps = np.where(still, 0.001, 0.3) * rng.normal(size=(120, n, 2))
    positions, radii = np.cumsum(steps, axis=0), rng.uniform(0.05, 0.2, n)
    locked = locked_pairs(positions, radii, dt)
    window = round(3.0 / dt)
    for t in range(0, 120, 7):
        for i in range(n):
            for j in range(n):
                gap = np.linalg.norm(positions[t, i] - positions[t, j]) - radii[i] - radii[j]
                stand = t >= window and all(
                    np.linalg.norm(positions[t, k] - positions[t - window, k]) < 0.05
                    for k in (i, j)
                )
                assert locked[t, i, j] == (i != j and stand and gap <= 0.3)
    assert count_deadlocks(positions, radii, dt) <= locked.any(-1).sum()
    assert (count_deadlocks(positions, radii, dt) > 0) == locked.any()
