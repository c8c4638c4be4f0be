"""How commands move robots: holonomic or unicycle, by velocity or by acceleration.

A holonomic robot accelerates in any direction; the acceleration that a command asks for is held for
the control step. A unicycle drives along its heading and turns. Its wheels have grip, which removes
sideways velocity in every physics step, up to a limit. So the constraint holds between control
steps too, where a push or a turn would violate it. With little grip, wheels slip: they spin where
motors push harder, and the robot skids where it turns. The limit is that of both together, but for
wheels with the usual grip, of which each holds along and across apart (`USUAL_GRIP`).

Commands are in [-1, 1] and scaled by the robot's limits. Holonomic: a velocity (or acceleration),
its norm clipped to 1. Unicycle: forward speed (or acceleration), and turn rate; of a differential
drive, both are scaled down where a wheel would be too fast (`Robot.command_norm`).

The limits apply to commands only. A robot that is pushed may exceed `max_speed`, by up to 17 %
("Contacts" in docs/measurements.md).
"""

import math

import numpy as np

from swarmdata.runtime.kernels import kernel
from swarmdata.specs.task_spec import Robot, TaskSpec
from swarmdata.types import Bool, Counts, Double, Float, Int

SPEED, ACCELERATION, BY_VELOCITY, TURN_RATE, UNICYCLE, GRIP, MASS, FRICTION, DIFFERENTIAL = range(9)
"""Columns of the limits, `task_spec.Robot`."""

N_LIMITS = 9
"""Number of these columns."""

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
    """Turns the heading by 2 atan(angle / 2), which differs from `angle` by about angle^3 / 12.

    This Cayley transform needs no sine, so the bits are the same on every platform.
    """
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
    out: Double,  # m/s^2, [N, 2]; kept for holonomic robots after the first physics step
) -> None:
    """Writes the accelerations of one copy's robots in physics step `k` of a control step."""
    for i in range(robots.shape[0]):
        if limits[i, UNICYCLE] == 1.0:
            out[i, 0], out[i, 1] = _unicycle(robots[i], commands[i], limits[i], dt)
        elif k == 0:
            control_dt = n_substeps * dt
            out[i, 0], out[i, 1] = _holonomic(robots[i], commands[i], limits[i], control_dt)
