"""The columns of a global state, float32 [S]: robots, then movable bodies, then the task's own.

States are not exactly Markov: after a step with a contact they lack the memory of the solver, which
moves robots by up to 4 mm in the next step, and by up to 31 mm where they press a payload
(docs/measurements.md, "Contacts").
"""

from swarmdata.errors import SchemaError
from swarmdata.types import Column, Float

ROBOT = ("x", "y", "vx", "vy", "ux", "uy", "tx", "ty")
"""Columns of a robot, as `robot_columns` describes them."""

X, Y, VX, VY, UX, UY, TX, TY = range(len(ROBOT))

N_COLUMNS = len(ROBOT)

BODY = ("x", "y", "vx", "vy", "ux", "uy", "turn_rate")
"""Columns of a movable body, as `body_columns` describes them."""

_SPEED = "; no faster than the robot's max_speed, unless it is in contact"
_HEADING = "; a unit vector, always (1, 0) on a holonomic robot"
_TARGET = ", the point where the robot should be"


def pair(
    prefix: str, what: str, unit: str, half: tuple[float, float] | None, more: str = ""
) -> tuple[Column, ...]:
    """The columns `<prefix>x` and `<prefix>y` of the vector `what` in the world's frame.

    Their largest absolute values are `half`; `more` is the rest of the meaning, with punctuation.
    """
    return tuple(
        Column(f"{prefix}{c}", f"{c} of the {what}{more}", unit, most and -most, most, "world")
        for c, most in zip("xy", half or (None, None), strict=True)
    )


def robot_columns(half: tuple[float, float]) -> tuple[Column, ...]:
    """The columns of each robot in an arena of this half width and half height (m)."""
    return (
        *pair("", "centre's position", "m", half),
        *pair("v", "velocity", "m/s", None, _SPEED),
        *pair("u", "heading", "", (1.0, 1.0), _HEADING),
        *pair("t", "target", "m", half, _TARGET),
    )


def body_columns(half: tuple[float, float]) -> tuple[Column, ...]:
    """The columns of each movable body in an arena of this half width and half height (m)."""
    return (
        *pair("", "position of the payload's centre", "m", half),
        *pair("v", "velocity of the payload", "m/s", None),
        *pair("u", "direction of the payload's local x axis", "", (1.0, 1.0), "; a unit vector"),
        Column("turn_rate", "turn rate of the payload, counter-clockwise", "rad/s"),
    )


def state_size(n_agents: int, n_movables: int, n_extras: int) -> int:
    """Length S of a state row."""
    return N_COLUMNS * n_agents + len(BODY) * n_movables + n_extras


def robots_of(states: Float, n_agents: int) -> Float:
    """Views the robots of states [..., S] as [..., N, 8], columns `ROBOT`.

    Raises:
        SchemaError: the states are too short for so many robots.
    """
    if states.shape[-1] < N_COLUMNS * n_agents:
        raise SchemaError(
            f"states are {list(states.shape)}, expected at least [..., {N_COLUMNS * n_agents}] "
            f"for {n_agents} robots. Pass the spec that made them."
        )
    return states[..., : N_COLUMNS * n_agents].reshape(*states.shape[:-1], n_agents, N_COLUMNS)
