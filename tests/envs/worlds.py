"""Specs and seeds of worlds, and whether steps are the same and places keep their distances."""

from typing import Any

import numpy as np

from swarmdata.numerics.geometry import bounding_radius, clearance
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Double, Float, Seeds, Step

ROUNDING = 1e-5
NO_OBSTACLES = {"circles": 0, "boxes": 0, "corners": 0, "pockets": 0}


def seeds_of(*values: int) -> Seeds:
    """Episode seeds, [len(values)]."""
    return np.array(values, dtype=np.uint64)


def rules_of(spec: TaskSpec, **changes: Any) -> TaskSpec:
    """The spec with other rules in part."""
    return spec.with_updates(rules={**spec.rules.model_dump(), **changes})


def arranged(spec: TaskSpec, arrangement: dict[str, Any] | None = None, **fields: Any) -> TaskSpec:
    """The spec with another arrangement in part, and with other fields."""
    plain = spec.model_dump()
    plain["rules"]["arrangement"] |= arrangement or {}
    return TaskSpec.parse({**plain, **fields})


def assert_same(left: list[Step], right: list[Step]) -> None:
    """Checks that all arrays of all steps are equal."""
    for a, b in zip(left, right, strict=True):
        for name in Step._fields:
            np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=name)


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
