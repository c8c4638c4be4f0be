"""How commands move robots: holonomic or unicycle, by velocity or by acceleration.

A holonomic robot accelerates in any direction; the acceleration that a command asks for is held for
the control step. A unicycle drives along its heading and turns. Its wheels have grip, which removes
sideways velocity in every physics step, up to a limit; with little grip, they spin and skid. The
limit is that of both together, but for wheels with the usual grip, of which each holds along and
across apart (`USUAL_GRIP`).

Commands in [-1, 1] are scaled by the robot's limits. Holonomic: a velocity (or acceleration), its
norm clipped to 1. Unicycle: forward speed (or acceleration), and turn rate; of a differential
drive, both are scaled down where a wheel would be too fast (`Robot.command_norm`). A robot that is
pushed may exceed `max_speed`, by up to 17 % ("Contacts" in docs/measurements.md).

A command takes effect `command_delay` control steps late, (0, 0) until then. The motors' command u
then follows the one that has arrived, c, with u = 0 at the start:

    u <- u + (1 - exp(-dt / lag)) (c - u)

the exact solution of lag du/dt = c - u over a step, in every simulator: `drive` takes u.
"""

import math

import numpy as np

from swarmdata.numerics.episode_draws import drawn_values
from swarmdata.numerics.exact_math import exp
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.task_spec import Robot, TaskSpec
from swarmdata.types import Bool, Counts, Double, Float, Int, Seeds

SPEED, ACCELERATION, BY_VELOCITY, TURN_RATE, UNICYCLE, GRIP, MASS, FRICTION, DIFFERENTIAL = range(9)
"""Columns of the limits, `task_spec.Robot`."""

N_LIMITS = 9  # number of these columns

USUAL_GRIP = float(Robot.model_fields["wheel_grip"].default)
"""m/s^2. Published worlds have wheels with this grip and keep their bits. With the usual motors of
1.5 m/s^2, both limits together are at most 1 % above the limit of both."""


def limits_of(spec: TaskSpec) -> Double:
    """Returns the robots' limits and bodies, in SI units, and flags, [N, 9]."""
    return np.array(
        [
            (
                robot.max_speed,
                robot.acceleration,
                robot.command == "velocity",
                robot.max_turn_rate,
                robot.dynamics == "unicycle",
                robot.wheel_grip,
                robot.mass,
                robot.friction,
                robot.drive == "differential",
            )
            for robot in spec.robots
        ],
        dtype=np.float64,
    )


@kernel
def begin_step(
    limits: Double,  # [N, 9]
    active: Bool,  # [E] written: the copies that have not ended
    commands: Double,  # [E, N, 2] written
    actions: Float | Double,  # [E, N, A] the first two columns are commands
    terminations: Bool,  # [E] of the step before
    truncations: Bool,  # [E] of the step before
    old_times: Int,  # [E] of the step before
    old_states: Float,  # [E, S] of the step before
    times: Int,  # [E] written: the old times, plus one in active copies
    states: Float,  # [E, S] written: the old states
    events: Counts,  # [E, N, 4] written: zeros
) -> int:
    """Finds the active copies, clips their commands, and begins their step.

    Returns:
        The number of active copies; -1 if an action of one of them is not finite.
    """
    n_active = 0
    for b in range(actions.shape[0]):
        active[b] = not (terminations[b] or truncations[b])
        events[b] = 0
        times[b] = old_times[b]
        for c in range(states.shape[1]):
            states[b, c] = old_states[b, c]
        if not active[b]:
            continue
        n_active += 1
        times[b] += 1
        for i in range(actions.shape[1]):
            for c in range(actions.shape[2]):
                if not math.isfinite(actions[b, i, c]):
                    return -1
            x, y = np.float64(actions[b, i, 0]), np.float64(actions[b, i, 1])
            if limits[i, UNICYCLE] == 1.0:
                commands[b, i, 0] = min(max(x, -1.0), 1.0)
                commands[b, i, 1] = min(max(y, -1.0), 1.0)
                if limits[i, DIFFERENTIAL] == 1.0:
                    scale = max(abs(commands[b, i, 0]) + abs(commands[b, i, 1]), 1.0)
                    commands[b, i, 0] /= scale
                    commands[b, i, 1] /= scale
                continue
            norm = math.sqrt(x * x + y * y)
            scale = norm if norm > 1.0 else 1.0
            commands[b, i, 0] = x / scale
            commands[b, i, 1] = y / scale
    return n_active


@kernel(inline="always")
def _holonomic(robot: Double, command: Double, limit: Double, dt: float) -> tuple[float, float]:
    """Returns the acceleration that is held for a control step of `dt` seconds."""
    top, most = limit[SPEED], limit[ACCELERATION]
    if limit[BY_VELOCITY] == 1.0:
        ax, ay = (top * command[0] - robot[2]) / dt, (top * command[1] - robot[3]) / dt
        norm = math.sqrt(ax * ax + ay * ay)
        if norm > most:
            return ax * most / norm, ay * most / norm
        return ax, ay
    ax, ay = most * command[0], most * command[1]
    vx, vy = robot[2] + ax * dt, robot[3] + ay * dt
    speed = math.sqrt(vx * vx + vy * vy)
    if speed > top:  # the speed limit holds for acceleration commands too
        return (vx * top / speed - robot[2]) / dt, (vy * top / speed - robot[3]) / dt
    return ax, ay


@kernel(inline="always")
def _turn(robot: Double, angle: float) -> None:
    """Turns the heading by 2 atan(angle / 2), by about angle^3 / 12 less; this needs no sine."""
    t = 0.5 * angle
    scale = 1.0 / (1.0 + t * t)
    cos, sin = (1.0 - t * t) * scale, 2.0 * t * scale
    ux, uy = robot[4] * cos - robot[5] * sin, robot[4] * sin + robot[5] * cos
    norm = math.sqrt(ux * ux + uy * uy)
    robot[4], robot[5] = ux / norm, uy / norm


@kernel(inline="always")
def _unicycle(robot: Double, command: Double, limit: Double, dt: float) -> tuple[float, float]:
    """Turns the robot, and returns its acceleration for one physics step of `dt` seconds."""
    _turn(robot, limit[TURN_RATE] * command[1] * dt)
    ux, uy = robot[4], robot[5]
    ahead, aside = robot[2] * ux + robot[3] * uy, robot[3] * ux - robot[2] * uy
    top, most = limit[SPEED], limit[ACCELERATION]
    if limit[BY_VELOCITY] == 1.0:
        wanted = top * command[0]
    else:
        wanted = min(max(ahead + most * command[0] * dt, -top), top)
    push = min(max((wanted - ahead) / dt, -most), most)
    hold = min(max(-aside / dt, -limit[GRIP]), limit[GRIP])
    asked = math.sqrt(push * push + hold * hold)
    if limit[GRIP] != USUAL_GRIP and asked > limit[GRIP]:
        push, hold = push * limit[GRIP] / asked, hold * limit[GRIP] / asked
    return push * ux - hold * uy, push * uy + hold * ux


@kernel(inline="always")
def drive(
    robots: Double,  # [N, 6] columns x, y, vx, vy, ux, uy; headings are turned
    commands: Double,  # [N, 2] clipped
    limits: Double,  # [N, 9]
    n_substeps: int,  # physics steps in a control step
    dt: float,  # length of a physics step, s
    k: int,  # number of the physics step, from 0
    out: Double,  # [N, 2] m/s^2; kept for holonomic robots after the first physics step
) -> None:
    """Writes the accelerations of one copy's robots in physics step `k` of a control step."""
    for i in range(robots.shape[0]):
        if limits[i, UNICYCLE] == 1.0:
            out[i, 0], out[i, 1] = _unicycle(robots[i], commands[i], limits[i], dt)
        elif k == 0:
            control_dt = n_substeps * dt
            out[i, 0], out[i, 1] = _holonomic(robots[i], commands[i], limits[i], control_dt)


@kernel
def _follow(
    active: Bool,  # [E]
    times: Int,  # [E] control steps taken, this one included
    delays: Int,  # [E, N] control steps
    shares: Double,  # [E, N] 1 - exp(-dt / lag)
    given: Double,  # [E, D + 1, N, 2] the last commands, a ring over time
    motors: Double,  # [E, N, 2] commands of the motors, read and written
    commands: Double,  # [E, N, 2] read and written
) -> None:
    """Replaces the commands of the active copies by those that reach the motors."""
    depth = given.shape[1]
    for b in range(commands.shape[0]):
        if not active[b]:
            continue
        for i in range(commands.shape[1]):
            sent = times[b] - delays[b, i]  # 1 in the first step
            for c in range(2):
                given[b, times[b] % depth, i, c] = commands[b, i, c]
                arrived = given[b, sent % depth, i, c] if sent > 0 else 0.0
                motors[b, i, c] += shares[b, i] * (arrived - motors[b, i, c])
                commands[b, i, c] = motors[b, i, c]


class Motors:
    """The motors of E teams."""

    def __init__(self, spec: TaskSpec, n_copies: int) -> None:
        n, self._spec = spec.n_agents, spec
        longest = int(max(spec.largest("command_delay")))
        self._delays: Int = np.zeros((n_copies, n), np.int64)
        self._shares: Double = np.zeros((n_copies, n))
        self._given: Double = np.zeros((n_copies, longest + 1, n, 2))
        self._motors: Double = np.zeros((n_copies, n, 2))

    @staticmethod
    def of(spec: TaskSpec, n_copies: int) -> "Motors | None":
        """The motors of a spec's robots; None if all of them follow commands at once."""
        has_any = any(map(any, (spec.largest("command_delay"), spec.largest("actuator_lag"))))
        return Motors(spec, n_copies) if has_any else None

    def reset(self, copies: Int, seeds: Seeds) -> None:
        """Stops the motors of some copies, [C], in which the episodes `seeds` begin, [C]."""
        robots, dt = self._spec.robots, self._spec.control_dt
        drawn = drawn_values(self._spec, seeds)
        delays = np.array([robot.command_delay for robot in robots], np.float64)
        lags = np.array([robot.actuator_lag for robot in robots])
        self._delays[copies] = drawn.get("command_delay", delays)
        lags = drawn.get("actuator_lag", lags)
        steps = np.divide(dt, lags, out=np.full_like(lags, np.inf), where=lags > 0.0)
        self._shares[copies] = 1.0 - exp(-steps)
        self._motors[copies] = 0.0

    def follow(self, active: Bool, times: Int, commands: Double) -> None:
        """Replaces commands [E, N, 2] by those that reach the motors, as `_follow` says."""
        _follow(
            active, times, self._delays, self._shares, self._given, self._motors, commands
        )  # fmt: skip
