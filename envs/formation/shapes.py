"""Shapes of a formation: the slots in the frame of its centre, which faces along +x."""

import math

import numpy as np

from swarmdata.envs.formation.formation_rules import FormationRules
from swarmdata.errors import SpecError
from swarmdata.types import Double

_GRID_STEPS = 2.0**20  # steps per unit to which sines are rounded, the same on every platform
MIN_SLOT_GAP = 0.05  # smallest gap (m) between robots in neighbouring slots


def slot_offsets(rules: FormationRules, n: int) -> Double:
    """Returns the slots of `n` robots, m, [n, 2]; their mean is the origin.

    line: side by side. column: one behind the other. wedge: a V with its tip ahead and its arms at
    45 degrees. circle: a regular polygon. Neighbours are `spacing` apart in all shapes.
    """
    k = np.arange(n, dtype=np.float64)
    if rules.shape == "line":
        offsets = np.stack([0.0 * k, k], axis=1)
    elif rules.shape == "column":
        offsets = np.stack([-k, 0.0 * k], axis=1)
    elif rules.shape == "wedge":
        row = np.ceil(k / 2) * math.sqrt(0.5)
        offsets = np.stack([-row, np.where(k % 2 == 1, row, -row)], axis=1)
    else:
        radius = 0.0 if n == 1 else 0.5 / _on_grid(math.sin(math.pi / n))
        turns = [2.0 * math.pi * i / n for i in range(n)]
        unit = [(_on_grid(math.cos(turn)), _on_grid(math.sin(turn))) for turn in turns]
        offsets = radius * np.array(unit)
    offsets = rules.spacing * offsets
    total = np.zeros(2)
    for offset in offsets:  # in order: the order of NumPy's sums differs between machines
        total += offset
    return offsets - total / n


def check_slots(rules: FormationRules, radii: Double) -> None:
    """Raises a `SpecError` if robots with these radii [N] could be too close in their slots."""
    need = float(np.sort(radii)[-2:].sum()) + MIN_SLOT_GAP
    if len(radii) > 1 and rules.spacing < need:
        raise SpecError(
            f"rules.spacing is {rules.spacing:g} m, expected at least {need:g} m: two robots of "
            f"the largest radii, and {MIN_SLOT_GAP:g} m. Enlarge the spacing or take smaller "
            "robots."
        )


def reach_of(offsets: Double) -> float:
    """Returns the distance of the farthest slot from the centre, m."""
    return float(np.sqrt((offsets * offsets).sum(axis=1)).max())


def _on_grid(value: float) -> float:
    return round(value * _GRID_STEPS) / _GRID_STEPS
