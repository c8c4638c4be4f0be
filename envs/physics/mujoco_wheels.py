"""A robot on two driven wheels and a caster, as a part of a MuJoCo model.

The chassis is free in space and stands on the floor: wheels, which are spheres, left and right of
its centre, a caster without friction behind. All centres are at the height of the axle, so the hull
is the disc of the planar robots. Each wheel has a motor that holds a speed (`wheel_speeds`), with a
gain for 1 kg. Wheels slip beyond `wheel_grip`, a turn takes time, a push turns the robot.
"""

from typing import Any, NamedTuple

import mujoco
import numpy as np

from swarmdata.envs.physics.dynamics import (
    ACCELERATION,
    BY_VELOCITY,
    FRICTION,
    GRIP,
    MASS,
    SPEED,
    TURN_RATE,
)
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.task_spec import SURFACE_FRICTION, Robot
from swarmdata.types import Double

GRAVITY = 9.81  # m/s^2; it acts on payloads and on robots with wheels
WHEEL_RADIUS = 0.05  # m, of wheels, casters and feet of payloads: the height of all centres
TRACK = 1.4  # distance between the wheels, in radii of the robot
CASTER, MASS_CENTRE = 0.8, 0.2  # distance behind the axle, in radii of the robot
WHEEL_SHARE = 1.0 - MASS_CENTRE / CASTER  # of the weight, on the wheels

ROTOR_SHARE = 0.2
"""Of the robot's inertia along the floor, in the rotors of both motors, behind their gears. A wheel
without it would change its speed at once where it slips, which takes far shorter steps."""

WHEEL_MASS = 0.01  # of one wheel, in masses of the robot
RESPONSE_TIME = 0.08  # time constant (s) with which motors bring 1 kg to a speed
TORQUE_RESERVE = 2.0  # largest torque, in those that drive the robot by its largest acceleration
N_POSITIONS, N_VELOCITIES = 9, 8  # of a robot: a free joint, the left and right wheel
FLOOR = 2  # class of collisions of the floor; what stands on it collides with nothing else

ON_FLOOR = {"contype": 0, "conaffinity": FLOOR, "solimp": (0.99, 0.99, 0.001, 0.5, 2.0)}
"""Of geoms that stand on the floor. With MuJoCo's default hardness of 0.9 they would creep."""


class Wheeled(NamedTuple):
    """The parts of a robot that episodes change."""

    radius: float  # m
    chassis: Any
    hull: Any  # a geom
    wheels: tuple[Any, ...]  # bodies, left and right
    axles: tuple[Any, ...]  # joints
    tyres: tuple[Any, ...]  # geoms
    motors: tuple[Any, ...]  # actuators

    def write(self, model: Any, row: list[float]) -> None:
        """Gives the robot the body of an episode, `dynamics.limits_of`, [9]."""
        mass = row[MASS]
        rest, area = mass * (1.0 - ROTOR_SHARE - 2.0 * WHEEL_MASS), self.radius**2
        masses, inertias, frictions = model.body_mass, model.body_inertia, model.geom_friction
        masses[self.chassis.id] = rest
        inertias[self.chassis.id] = rest * area / 4, rest * area / 4, rest * area / 2
        for wheel in self.wheels:
            moment = WHEEL_MASS * mass * WHEEL_RADIUS**2
            masses[wheel.id], inertias[wheel.id] = (
                WHEEL_MASS * mass,
                (moment / 4, moment / 2, moment / 4),
            )
        for axle in self.axles:
            dof = model.jnt_dofadr[axle.id]
            model.dof_armature[dof] = ROTOR_SHARE * mass * WHEEL_RADIUS**2 / 2.0
        for tyre in self.tyres:
            frictions[tyre.id, 0] = row[GRIP] / (GRAVITY * WHEEL_SHARE * (1.0 - ROTOR_SHARE))
        torque = TORQUE_RESERVE * mass * row[ACCELERATION] * WHEEL_RADIUS / 2.0
        for motor in self.motors:
            model.actuator_forcerange[motor.id] = -torque, torque
        frictions[self.hull.id, 0] = SURFACE_FRICTION * row[FRICTION]


def add_wheeled(model: Any, name: str, robot: Robot, contact: dict[str, Any]) -> Wheeled:
    """Adds a robot to a `mujoco.MjSpec`; its motors follow those of the robots before it."""
    solid = {"explicitinertial": True, "mass": 1.0, "inertia": (1.0, 1.0, 1.0)}
    chassis = model.worldbody.add_body(
        name=name, ipos=(-MASS_CENTRE * robot.radius, 0.0, 0.0), **solid
    )
    chassis.add_freejoint()
    sphere, size = mujoco.mjtGeom.mjGEOM_SPHERE, (WHEEL_RADIUS, 0.0, 0.0)
    shape = {"type": sphere, "mass": 0.0}
    hull = chassis.add_geom(
        name=name, size=(robot.radius, 0.0, 0.0), priority=1, **shape, **contact
    )
    caster = (-CASTER * robot.radius, 0.0, 0.0)
    chassis.add_geom(size=size, pos=caster, condim=1, **shape, **ON_FLOOR)
    wheels, axles, tyres, motors = [], [], [], []
    for side, place in (("left", 1.0), ("right", -1.0)):
        wheel = chassis.add_body(
            name=f"{name}_{side}", pos=(0.0, place * TRACK * robot.radius / 2.0, 0.0), **solid
        )
        hinge = mujoco.mjtJoint.mjJNT_HINGE
        axles.append(wheel.add_joint(name=f"{name}_{side}", type=hinge, axis=(0, 1, 0)))
        smooth = {"friction": (0.0, 0.0, 0.0), "condim": 3}
        tyres.append(wheel.add_geom(size=size, **smooth, **shape, **ON_FLOOR))
        wheels.append(wheel)
        motors.append(_add_motor(model, f"{name}_{side}"))
    parts = (wheels, axles, tyres, motors)
    return Wheeled(robot.radius, chassis, hull, *map(tuple, parts))


def _add_motor(model: Any, name: str) -> Any:
    """Adds a motor of one of two wheels, which holds a speed."""
    gain = WHEEL_RADIUS**2 / (2.0 * RESPONSE_TIME)  # N m s
    return model.add_actuator(
        name=name,
        target=name,
        trntype=mujoco.mjtTrn.mjTRN_JOINT,
        gaintype=mujoco.mjtGain.mjGAIN_FIXED,
        biastype=mujoco.mjtBias.mjBIAS_AFFINE,
        gainprm=[gain] + [0.0] * 9,
        biasprm=[0.0, 0.0, -gain] + [0.0] * 7,
        forcelimited=True,
        forcerange=(-1.0, 1.0),
    )


def start(robot: Double, positions: Double, velocities: Double) -> None:
    """Writes the joint coordinates of a robot that starts: `positions` [9] and `velocities` [8].

    `robot`: x, y, vx, vy, ux, uy, [6].
    """
    half = 0.5 * np.arctan2(robot[5], robot[4])
    positions[:7] = robot[0], robot[1], 0.0, np.cos(half), 0.0, 0.0, np.sin(half)
    velocities[:2] = robot[2:4]
    velocities[6:8] = (robot[2] * robot[4] + robot[3] * robot[5]) / WHEEL_RADIUS


@kernel(inline="always")
def wheel_speeds(
    robot: Double, command: Double, limit: Double, radius: float
) -> tuple[float, float]:
    """The speeds of the left and right wheel (rad/s) that a unicycle's command asks for.

    They are ahead of the robot by no more than what its largest force along the floor takes.
    `robot`: x, y, vx, vy, ux, uy, [6]. `command`: clipped, [2]. `radius`: of the robot, m.
    """
    ahead = robot[2] * robot[4] + robot[3] * robot[5]
    top, lead = limit[SPEED], limit[ACCELERATION] * limit[MASS] * RESPONSE_TIME
    if limit[BY_VELOCITY] == 1.0:
        wanted = top * command[0]
    else:
        wanted = min(max(ahead + lead * command[0], -top), top)
    speed = ahead + min(max(wanted - ahead, -lead), lead)
    turn = limit[TURN_RATE] * command[1] * TRACK * radius / 2.0
    return (speed - turn) / WHEEL_RADIUS, (speed + turn) / WHEEL_RADIUS


@kernel(inline="always")
def read(positions: Double, velocities: Double, place: int, speed: int, robot: Double) -> None:
    """Reads a robot x, y, vx, vy, ux, uy, [6], from its joint coordinates.

    `positions` and `velocities` are those of all joints; the robot's begin at `place` and `speed`.
    """
    for c in range(2):
        robot[c], robot[2 + c] = positions[place + c], velocities[speed + c]
    w, x, y, z = (
        positions[place + 3],
        positions[place + 4],
        positions[place + 5],
        positions[place + 6],
    )
    ux, uy = w * w + x * x - y * y - z * z, 2.0 * (x * y + w * z)
    norm = np.sqrt(ux * ux + uy * uy)
    robot[4], robot[5] = ux / norm, uy / norm
