"""How a team pushes: who takes which slot, who is in its slot, and how hard each robot pushes."""

import numpy as np

from swarmdata.behavior_policies.transport.payload_detour import crosses
from swarmdata.behavior_policies.transport.push_setup import PayloadState, PushSetup
from swarmdata.numerics.geometry import CIRCLE
from swarmdata.runtime.kernels import kernel
from swarmdata.types import Double, Int

WAITING_GAP = 0.03  # gap (m) to the payload at which a robot waits until it is beside its slot
DETOUR_LENGTH = 1.0  # m that going around the payload counts for in the assignment of slots
SWAP_MIN_GAIN = 0.02  # m^2 by which summed squares of paths shrink if robots swap slots
SLOT_SIDE_TOLERANCE, SLOT_GAP_TOLERANCE = 0.06, 0.05  # m along and off the face, in a slot
SLOT_LOST_DISTANCE = 0.14  # m along or off the face, beyond which a pushing robot has lost its slot
ARC_SIDE_TOLERANCE = 0.3  # m along a circle from its slot within which a robot still pushes
PUSH_MIN_FRICTION_RATIO, PUSH_MIN_COSINE = 1.05, 0.93  # of a push that may begin
PAYLOAD_SPEED = 0.4  # m/s that the team aims at; it leaves robots room to catch up
VELOCITY_RESPONSE_TIME = 0.5  # seconds in which an error of the payload's velocity is corrected
TURN_DAMPING = 5.0  # force against turning, N per (rad/s of turn rate times m of lever)


@kernel
def assign_slots(
    robots: Double, payload: PayloadState, slots: Double, margin: float, out: Int
) -> None:
    """Writes the slot of each robot, or -1, [N]; starts from those in `out` if all slots are taken.

    Path lengths count by their squares: two robots move a little rather than one past the other.
    `slots`: of `push_slots.choose_slots`, [K, 4], K at most N. `margin`: by which a straight path
    must miss the payload, m.
    """
    n, k = robots.shape[0], slots.shape[0]
    costs = np.empty((n, k))
    for i in range(n):
        for s in range(k):
            x = slots[s, 0] - WAITING_GAP * slots[s, 2]
            y = slots[s, 1] - WAITING_GAP * slots[s, 3]
            dx, dy = x - robots[i, 0], y - robots[i, 1]
            length = np.sqrt(dx * dx + dy * dy)
            if crosses(payload, (robots[i, 0], robots[i, 1]), (x, y), margin):
                length += DETOUR_LENGTH
            costs[i, s] = length * length
    if (out >= 0).sum() != k or out.max() >= k:
        out[:] = -1
        for s in range(k):
            best, robot = np.inf, 0
            for i in range(n):
                if out[i] < 0 and costs[i, s] < best:
                    best, robot = costs[i, s], i
            out[robot] = s
    _swap(costs, out)


@kernel
def _swap(costs: Double, out: Int) -> None:
    n, has_changed = costs.shape[0], True
    while has_changed:
        has_changed = False
        for i in range(n):
            for j in range(n):
                if out[i] < 0:
                    continue
                cost, swapped = costs[i, out[i]], costs[j, out[i]]
                if out[j] >= 0:
                    cost, swapped = cost + costs[j, out[j]], swapped + costs[i, out[j]]
                if swapped < cost - SWAP_MIN_GAIN:
                    out[i], out[j] = out[j], out[i]
                    has_changed = True


@kernel
def contact(
    robot: Double, inset: float, payload: PayloadState, slot: Double
) -> tuple[float, float, float, float]:
    """Direction of a robot's push, and how far its slot is to the left and ahead of it, m.

    At a box it pushes along the face's normal, wherever it stands; at a circle towards the centre.
    `inset`: how much smaller the robot's radius is than that of the slots, m. `slot`: [4].
    """
    body, shape = payload
    dx, dy, nx, ny = slot[0] - robot[0], slot[1] - robot[1], slot[2], slot[3]
    ahead = dx * nx + dy * ny
    if shape[0] == CIRCLE:
        bx, by = body[0] - robot[0], body[1] - robot[1]
        d = max(np.sqrt(bx * bx + by * by), 1e-9)
        sx, sy = body[0] - slot[0], body[1] - slot[1]
        nx, ny = bx / d, by / d
        ahead = d - np.sqrt(sx * sx + sy * sy)
    return nx, ny, dy * nx - dx * ny, ahead + inset


@kernel
def stands(left: float, ahead: float, is_circle: bool, was_pushing: bool) -> bool:
    """Whether a robot is in its slot, from the last two values of `contact`."""
    side = SLOT_LOST_DISTANCE if was_pushing else SLOT_SIDE_TOLERANCE
    gap = SLOT_LOST_DISTANCE if was_pushing else SLOT_GAP_TOLERANCE
    return abs(left) < (ARC_SIDE_TOLERANCE if is_circle else side) and abs(ahead) < gap


@kernel
def feasible_direction(direction: tuple[float, float], pushes: Double) -> tuple[float, float]:
    """The direction nearest to the wanted one in which pushes [K, 4] can move the payload.

    A unit vector, or (0, 0) if no push, a position and a direction, has a component along it.
    """
    wx, wy = 0.0, 0.0
    for k in range(pushes.shape[0]):
        nx, ny = pushes[k, 2], pushes[k, 3]
        ahead = max(direction[0] * nx + direction[1] * ny, 0.0) / _share(pushes, k)
        wx, wy = wx + ahead * nx, wy + ahead * ny
    length = np.sqrt(wx * wx + wy * wy)
    if length < 1e-9:
        return 0.0, 0.0
    return wx / length, wy / length


@kernel
def _share(pushes: Double, k: int) -> float:
    """Number of robots that share the work of push k: parallel ones count fully."""
    share = 0.0
    for j in range(pushes.shape[0]):
        along = max(pushes[j, 2] * pushes[k, 2] + pushes[j, 3] * pushes[k, 3], 0.0)
        share += along * along
    return share


@kernel
def _share_force(
    body: Double, wanted: tuple[float, float], pushes: Double, limit: float, out: Double
) -> tuple[float, float, float]:
    """Shares a force, scaled down until no robot exceeds `limit` N; returns force and torque."""
    peak = limit
    for k in range(pushes.shape[0]):
        along = wanted[0] * pushes[k, 2] + wanted[1] * pushes[k, 3]
        out[k] = max(along, 0.0) / _share(pushes, k)
        peak = max(peak, out[k])
    x, y, torque = 0.0, 0.0, 0.0
    for k in range(pushes.shape[0]):
        out[k] *= limit / peak
        fx, fy = out[k] * pushes[k, 2], out[k] * pushes[k, 3]
        x, y = x + fx, y + fy
        torque += (pushes[k, 0] - body[0]) * fy - (pushes[k, 1] - body[1]) * fx
    return x, y, torque


@kernel
def push_forces(
    body: Double, direction: tuple[float, float], pushes: Double, setup: PushSetup, out: Double
) -> bool:
    """Writes the force (N, not negative) of each push [K, 4] that moves the payload, [K].

    The team's force overcomes friction and corrects the velocity; it is shared among the robots of
    a face, and the side that lags behind pushes harder. A push is a position and a direction;
    `direction` is that of `feasible_direction`.

    Returns:
        Whether these pushes start the payload closely enough along it, without turning it.
    """
    mass, friction = setup.moved_mass / VELOCITY_RESPONSE_TIME, setup.friction
    dx, dy = direction
    fx = friction * dx + mass * (PAYLOAD_SPEED * dx - body[2])
    fy = friction * dy + mass * (PAYLOAD_SPEED * dy - body[3])
    start = friction + mass * PAYLOAD_SPEED
    limit = setup.robot_force
    x, y, torque = _share_force(body, (start * dx, start * dy), pushes, limit, out)
    ahead, total = x * dx + y * dy, np.sqrt(x * x + y * y)
    _share_force(body, (fx, fy), pushes, limit, out)
    for k in range(pushes.shape[0]):
        lever = (pushes[k, 0] - body[0]) * pushes[k, 3] - (pushes[k, 1] - body[1]) * pushes[k, 2]
        out[k] = min(max(out[k] - TURN_DAMPING * body[6] * lever, 0.0), limit)
    is_along = ahead > PUSH_MIN_FRICTION_RATIO * friction and ahead > PUSH_MIN_COSINE * total
    return is_along and abs(torque) < setup.held_torque
