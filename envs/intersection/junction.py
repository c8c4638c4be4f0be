"""The floor of an intersection: four arms between solid corners, with an entry and an exit each.

Arm 0 leads to the east, 1 to the north, 2 to the west, 3 to the south. At the outer end of each arm
are its two gates, side by side: the entry on the right-hand side of those who drive in, the exit on
the right-hand side of those who drive out.

    ##########  x  e  ##########
    ##########        ##########
    ##########        ##########
    e                          x
                                    e: entries
    x                          e    x: exits
    ##########        ##########    #: corners
    ##########        ##########
    ##########  e  x  ##########

(The drawing is to scale for no width; x and e stand a quarter of the arm's width from its middle.)

Between two points on this floor, the length of the shortest path along the axes is |dx| + |dy|: a
path turns at most once, in the middle square.
"""

from dataclasses import dataclass

import numpy as np

from swarmdata.envs.intersection.intersection_rules import IntersectionRules
from swarmdata.errors import SpecError
from swarmdata.numerics.geometry import BOX
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Double, Float

ARM_DIRECTIONS = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
"""Unit vector from the middle to the end of each arm, [4, 2]."""

N_ARMS = len(ARM_DIRECTIONS)

STANDOFF_GAP = 0.05  # gap (m) between a wall and a robot in the middle of a gate
MIN_ARM_LENGTH = 0.5  # smallest length of an arm, from the middle square to the wall, m


@dataclass(frozen=True, eq=False)
class Junction:
    """Positions in metres; the origin is the middle."""

    corners: Float  # [4, 8] layout rows
    entries: Double  # [4, 2] gate of each arm for those who drive in
    exits: Double  # [4, 2] gate of each arm for those who drive out
    half_width: float  # of an arm, and of the middle square

    @classmethod
    def of(cls, spec: TaskSpec) -> "Junction":
        """Lays out the intersection of a spec.

        Raises:
            SpecError: the spec is another task's, or leaves no room for arms or robots.
        """
        rules = spec.rules_as(IntersectionRules)
        radius = max(robot.radius for robot in spec.robots)
        half = np.array(spec.half_size)
        _check_room(rules.arm_width, half, radius)
        half_width = rules.arm_width / 2
        reach = np.abs(ARM_DIRECTIONS) @ half - radius - STANDOFF_GAP  # [4]
        ends = reach[:, None] * ARM_DIRECTIONS
        right = np.stack([-ARM_DIRECTIONS[:, 1], ARM_DIRECTIONS[:, 0]], axis=-1)  # driving in
        return cls(
            corners=_corners(half, half_width),
            entries=ends + right * (half_width / 2),
            exits=ends - right * (half_width / 2),
            half_width=half_width,
        )


def _check_room(width: float, half: Double, radius: float) -> None:
    """Raises if two robots cannot pass each other in an arm, or arms are too short."""
    need = 4 * (radius + STANDOFF_GAP)
    if width < need:
        raise SpecError(
            f"arm_width is {width:g} m, expected at least {need:g} m: two robots of radius "
            f"{radius:g} m, with a gap of {STANDOFF_GAP:g} m on both sides of each."
        )
    length = float(half.min()) - width / 2
    if length < MIN_ARM_LENGTH:
        raise SpecError(
            f"arms would be {length:.3g} m long, expected at least {MIN_ARM_LENGTH:g} m. Enlarge "
            f"the arena, or make arm_width smaller than {width:g} m."
        )


def _corners(half: Double, half_width: float) -> Float:
    """Returns the boxes between the arms, [4, 8]."""
    corners = np.zeros((N_ARMS, 8), dtype=np.float32)
    corners[:, 0], corners[:, 3] = BOX, 1.0
    signs = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])
    corners[:, 1:3] = signs * (half + half_width) / 2
    corners[:, 5:7] = (half - half_width) / 2
    return corners


@kernel(inline="always")
def arm_at(x: float, y: float) -> int:
    """The arm that a point is in; in the middle square, that of the nearest side."""
    if abs(x) > abs(y):
        return 0 if x > 0.0 else 2
    return 1 if y > 0.0 else 3


@kernel(inline="always")
def next_corner(
    x: float, y: float, target_x: float, target_y: float, half_width: float
) -> tuple[float, float]:
    """Returns the point (m) to drive to next: the target, or where the path turns before it.

    A robot in an arm drives along it, before it turns into one that crosses it. With noise, it may
    believe that it is inside a corner. The target is a gate. `half_width`: of an arm, m.
    """
    if abs(y) > half_width and abs(target_x) > half_width:
        return x, target_y
    if abs(x) > half_width and abs(target_y) > half_width:
        return target_x, y
    return target_x, target_y
