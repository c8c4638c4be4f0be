"""Whether places keep the distances that a spec asks for."""

import numpy as np

from swarmdata.numerics.geometry import bounding_radius, clearance
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Double, Float

ROUNDING = 1e-5


def gaps_of(points: Double, radii: Double) -> Double:
    """Gaps between circles, infinite on the diagonal, [N, N]."""
    gaps = np.linalg.norm(points[:, None] - points, axis=-1) - radii[:, None] - radii
    np.fill_diagonal(gaps, np.inf)
    return gaps


def check_places(
    spec: TaskSpec,
    layout: Float,
    points: Double,
    clear: float,
    apart: float,
    radii: Double | None = None,
) -> None:
    """Checks the gaps of discs, by default robots, to obstacles and walls, and to each other."""
    if radii is None:
        radii = np.array([robot.radius for robot in spec.robots])
    half = np.array(spec.half_size)
    room = [clearance(x, y, layout, half) for x, y in points] - radii
    assert room.min() >= clear - ROUNDING
    assert gaps_of(points, radii).min() >= apart - ROUNDING


def check_obstacles(spec: TaskSpec, layout: Float) -> None:
    """Checks that bounding circles of drawn obstacles keep their gap."""
    places, reach = layout[:, 1:3].astype(float), np.array([bounding_radius(m) for m in layout])
    gap = spec.obstacles.gap - ROUNDING
    assert (np.array(spec.half_size) - np.abs(places) >= reach[:, None] + gap).all()
    assert gaps_of(places, reach).min(initial=np.inf) >= gap
