"""Robots that meet head on pass on one side, seen from any direction."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmdata.analysis.passings import Passings, passings
from swarmdata.specs.state_layout import N_COLUMNS
from swarmdata.specs.task_spec import Role, TaskSpec
from swarmdata.types import Float

TWO = TaskSpec(team=(Role(count=2),))
STEPS = 60


def drive(
    starts: list[tuple[float, float]], velocities: list[tuple[float, float]], turn: float = 0.0
) -> Float:
    """States of robots that drive straight, turned about the origin, [T+1, S]."""
    times = 0.1 * np.arange(STEPS)[:, None, None]
    places = np.array(starts) + times * np.array(velocities)
    rotation = np.array([(np.cos(turn), np.sin(turn)), (-np.sin(turn), np.cos(turn))])
    states = np.zeros((STEPS, len(starts), N_COLUMNS), np.float32)
    states[..., :2] = places @ rotation
    states[..., 2:4] = np.array(velocities) @ rotation
    return states.reshape(STEPS, -1)


def meeting(offset: float, turn: float = 0.0) -> Float:
    """One drives right, the other left and `offset` above it."""
    return drive([(-1.2, 0.0), (1.2, offset)], [(0.5, 0.0), (-0.5, 0.0)], turn)


@given(st.floats(0.02, 0.45), st.floats(-7, 7), st.booleans())
def test_a_turned_world_has_the_same_sides_and_a_mirrored_one_the_other(
    offset: float, turn: float, swap: bool
) -> None:
    # the other one is above, on the left of who drives right: both keep to their right
    states = meeting(offset, turn)
    if swap:
        states = states.reshape(STEPS, 2, -1)[:, ::-1].reshape(STEPS, -1)
    assert passings(states, TWO) == Passings(1, 0)
    mirrored = states.copy()
    mirrored[:, [1, 3, N_COLUMNS + 1, N_COLUMNS + 3]] *= -1
    assert passings(mirrored, TWO) == Passings(0, 1)


@pytest.mark.parametrize(
    "states",
    [
        meeting(0.7),  # too far apart to give way
        drive([(-1.2, 0.0), (-1.9, 0.3)], [(0.2, 0.0), (0.6, 0.0)]),  # overtaking
        drive([(-1.2, 0.0), (0.0, -1.2)], [(0.5, 0.0), (0.0, 0.5)]),  # crossing
        drive([(-1.2, 0.0), (0.0, 0.3)], [(0.5, 0.0), (0.0, 0.0)]),  # one stands
        drive([(0.2, 0.0), (-0.2, 0.3)], [(0.5, 0.0), (-0.5, 0.0)]),  # together from the start
        meeting(0.3)[:22],  # the episode ends before they have passed
    ],
)
def test_other_meetings_do_not_count(states: Float) -> None:
    assert passings(states, TWO) == Passings(0, 0)


def test_robots_behind_each_other_have_passed_and_meeting_again_counts_again() -> None:
    assert passings(meeting(0.3)[:32], TWO) == Passings(1, 0)
    there = meeting(0.3).reshape(STEPS, 2, -1)
    back = there[::-1].copy()
    back[..., 2:4] *= -1  # time reversed: they come back on the same lines, now on their left
    both = np.concatenate([there, back]).reshape(2 * STEPS, -1)
    assert passings(both, TWO) == Passings(1, 1)


def test_all_pairs_of_a_team_count() -> None:
    spec = TaskSpec(team=(Role(count=4),))
    states = drive(
        [(-1.2, 0.0), (1.2, 0.3), (-1.2, 9.0), (1.2, 8.8)],
        [(0.5, 0.0), (-0.5, 0.0), (0.5, 0.0), (-0.5, 0.0)],
    )
    assert passings(states, spec) == Passings(1, 1)
