"""What a row of global state consists of: the robots, then movable bodies, then the task's own.

Every task's state, float32 [S], starts with the N robots, `ROBOT` columns each. Tasks with movable
bodies go on with `BODY` columns for each; what follows belongs to the task and is described there.
"""

from swarmdata.errors import SchemaError
from swarmdata.types import Float

ROBOT = ("x", "y", "vx", "vy", "ux", "uy", "tx", "ty")
"""Position (m), velocity (m/s), heading (unit vector; (1, 0) for ever on a holonomic robot), and
target: the point (m) where the robot should be now."""

X, Y, VX, VY, UX, UY, TX, TY = range(len(ROBOT))

N_COLUMNS = len(ROBOT)

BODY = ("x", "y", "vx", "vy", "ux", "uy", "turn_rate")
"""Of a movable body: position (m), velocity (m/s), direction of its local x axis, rad/s."""


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
