"""Counts on which side robots that meet head on pass each other, a convention among them."""

from typing import NamedTuple

from swarmdata.runtime.kernels import kernel
from swarmdata.specs.state_layout import VX, VY, robots_of
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Double, Float

ENCOUNTER_DISTANCE = 1.0  # m between centres, at which an encounter begins and ends

PASSING_DISTANCE = 0.5
"""Largest distance between centres at the closest approach of a passing, m. Farther apart, nobody
had to give way."""

HEAD_ON_MAX_COSINE = -0.7  # between velocities when an encounter begins: 134 degrees apart

MOVING_MIN_SPEED = 0.1  # smallest speed of both robots when an encounter begins, m/s


class Passings(NamedTuple):
    """How often two robots that met head on passed each other on either side."""

    n_right: int  # each kept to its own right, with the other one on its left
    n_left: int

    @property
    def n(self) -> int:
        """Passings of both kinds."""
        return self.n_right + self.n_left


def passings(states: Float, spec: TaskSpec) -> Passings:
    """Counts the sides on which pairs of robots passed each other in an episode, states [T+1, S].

    An encounter of two robots is a stretch of time in which they are closer than
    `ENCOUNTER_DISTANCE`. It is head on if they were farther apart before and, in its first state,
    both move towards each other with roughly opposite velocities. It is a passing if they come
    closer than `PASSING_DISTANCE` and, in its last state, each has the other behind it, along the
    relative velocity of the first state. The side is that of the other robot at the closest
    approach. Encounters that the end of the episode cuts count too if the robots have passed each
    other by then.
    """
    robots = robots_of(states, spec.n_agents).astype("float64")
    n_right, n_left = 0, 0
    for i in range(spec.n_agents):
        for j in range(i):
            right, left = _passings(
                robots[:, i], robots[:, j], PASSING_DISTANCE, ENCOUNTER_DISTANCE
            )
            n_right, n_left = n_right + right, n_left + left
    return Passings(n_right, n_left)


@kernel
def _is_head_on(a: Double, b: Double) -> bool:
    """Whether two robots drive towards each other, nearly opposite; rows of one state, [8]."""
    va, vb = a[VX] * a[VX] + a[VY] * a[VY], b[VX] * b[VX] + b[VY] * b[VY]
    if min(va, vb) < MOVING_MIN_SPEED * MOVING_MIN_SPEED:
        return False
    product = a[VX] * b[VX] + a[VY] * b[VY]
    if product > 0.0 or product * product < HEAD_ON_MAX_COSINE * HEAD_ON_MAX_COSINE * va * vb:
        return False
    return (b[0] - a[0]) * (a[VX] - b[VX]) + (b[1] - a[1]) * (a[VY] - b[VY]) > 0.0


@kernel
def _side(a: Double, b: Double, first: int, last: int, near: float) -> int:
    """Returns 1 for a passing on the right in the states first to last, -1 on the left, else 0."""
    wx, wy = a[first, VX] - b[first, VX], a[first, VY] - b[first, VY]
    best, side = near * near, 0
    for t in range(first, last + 1):
        x, y = b[t, 0] - a[t, 0], b[t, 1] - a[t, 1]
        if x * x + y * y < best:
            best = x * x + y * y
            side = 1 if wx * y - wy * x > 0.0 else -1  # the other one is on the left
    x, y = b[last, 0] - a[last, 0], b[last, 1] - a[last, 1]
    return side if x * wx + y * wy < 0.0 else 0


@kernel
def _passings(a: Double, b: Double, near: float, reach: float) -> tuple[int, int]:
    n_right, n_left, first = 0, 0, 0
    was_apart, together = False, False
    for t in range(len(a)):
        x, y = b[t, 0] - a[t, 0], b[t, 1] - a[t, 1]
        is_close = x * x + y * y < reach * reach
        if is_close and was_apart:
            first, together = t, _is_head_on(a[t], b[t])
        if together and (not is_close or t == len(a) - 1):
            side = _side(a, b, first, t, near)
            n_right += side == 1
            n_left += side == -1
            together = False
        was_apart = not is_close
    return n_right, n_left
