"""The bands in which the measured figures of a tier must lie, and a check of them."""

from collections.abc import Mapping
from types import MappingProxyType

MEDIUM_SUCCESS = (0.4, 0.6)  # lowest and highest success of a medium team

EXPERT_AT_LEAST: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {
        "coop_nav": {"success": 0.95, "clean_success": 0.85},
        "formation": {"success": 0.95, "clean_success": 0.85},
        "transport": {"success": 0.9},
        "warehouse": {"success": 0.95, "clean_success": 0.75},
        "coop_nav-n8": {"success": 0.85},
        "formation-n8": {"success": 0.85},
        "intersection": {"success": 0.9, "clean_success": 0.75},
        "search": {"success": 0.9, "clean_success": 0.75},
        "search-lift": {"success": 0.95, "clean_success": 0.6},
        "pursuit": {"success": 0.95, "clean_success": 0.5},
        "coop_nav-corridor-strict": {"success": 0.95},
        "coop_nav-swap-strict": {"success": 0.95},
        "coop_nav-mixed": {"success": 0.85, "clean_success": 0.75},
        "warehouse-n8": {"success": 0.9, "clean_success": 0.4},
        "coop_nav-n16": {"success": 0.9, "clean_success": 0.35},
        "robotarium": {"success": 0.95, "clean_success": 0.75},
        "tag-pursuers": {"success": 0.85, "clean_success": 0.3},
        "tag-evader": {"success": 0.85},
        "coop_nav-lanes": {"success": 0.95, "clean_success": 0.85},
        "coop_nav-ranks": {"success": 0.95, "clean_success": 0.85},
        "coop_nav-strict": {"success": 0.7},
        "coop_nav-n8-strict": {"success": 0.5},
        "intersection-strict": {"success": 0.7},
        "search-strict": {"success": 0.7},
        "warehouse-strict": {"success": 0.8},
    }
)
"""Least figures of an expert team, by preset, or of a side by preset and side; that of
`coop_nav-n8` was trained in teams of 4, and those of the strict presets are the experts of the
presets without that rule."""

EXPERT_SHARE = 0.95
"""Least return of an expert team, as a share of the way from no skill to the scripted controller.

Experts see what robots see; the scripted controller reads the map, which is hard to beat.
"""


def out_of_band(
    family: str, figures: Mapping[str, Mapping[str, float]], *, is_borrowed: bool = False
) -> tuple[str, ...]:
    """Returns one message for each measured figure of a preset that is outside its band.

    Figures are means of each metric over the reserved episodes, without noise, of the policies
    `idle`, `random`, `scripted`, `medium` and `expert`. `is_borrowed`: whether the policies were
    selected in another preset, within its bands.
    """
    medium, expert = figures["medium"], figures["expert"]
    low, high = MEDIUM_SUCCESS
    problems = []
    for metric, least in EXPERT_AT_LEAST[family].items():
        if not expert[metric] >= least:
            problems.append(f"expert {metric} is {expert[metric]:.3f}, expected at least {least}")
    if not is_borrowed and not low <= medium["success"] <= high:
        problems.append(f"medium success is {medium['success']:.3f}, expected {low} to {high}")
    no_skill = max(figures["idle"]["return"], figures["random"]["return"])
    least = no_skill + EXPERT_SHARE * (figures["scripted"]["return"] - no_skill)
    if not is_borrowed and not expert["return"] >= least:
        problems.append(
            f"expert return is {expert['return']:.3f}, expected at least {least:.3f}, which is "
            f"{EXPERT_SHARE:.0%} of the way from no skill to the scripted controller"
        )
    return tuple(f"{family}: {problem}" for problem in problems)
