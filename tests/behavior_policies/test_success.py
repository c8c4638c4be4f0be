"""Scripted teams solve their tasks, with robots of every kind, and seldom touch anything."""

from typing import Any

import pytest

from swarmdata.envs.coop_nav.navigation_rules import NavigationRules
from swarmdata.registry.presets import preset, preset_names
from swarmdata.rollouts.evaluate import evaluate
from tests.support.pairs import every, slow

NAVIGATION = [name for name in preset_names() if isinstance(preset(name).rules, NavigationRules)]
CROSSED = {"success": 0.85}, {"robot_collisions": 0.1, "obstacle_collisions": 0.1}
DELIVERED = {"success": 0.75}, {"deadlocks": 0.1, "robot_collisions": 0.2}


def solved(least: float, **others: float) -> tuple[dict[str, float], dict[str, float]]:
    return {"success": least, **others}, {}


PRESETS = [
    ("intersection", 20, *CROSSED),
    *slow(("intersection-easy", 20, *CROSSED), ("intersection-n8", 20, *CROSSED)),
    *((f"warehouse{kind}", 40, *DELIVERED) for kind in ("", "-easy", "-n3", "-hard")),
    ("transport", 24, *solved(0.95, clean_success=0.8)),
    ("transport-easy", 8, *solved(0.99)),
    ("transport-n3", 12, *solved(0.8)),
    ("transport-n8", 8, *solved(0.8)),
    ("transport-hard", 16, *solved(0.6)),
    ("formation-unicycle", 20, *solved(0.8, clean_success=0.7)),
    *slow(*((f"formation{kind}", 20, *solved(0.8, clean_success=0.7)) for kind in ("", "-n8"))),
    ("coop_nav", 64, *solved(0.95, clean_success=0.9)),
    *slow(("search", 15, *solved(0.8))),
]

DRIVES = [
    {"dynamics": dynamics, "command": command}
    for dynamics in ("holonomic", "unicycle")
    for command in ("velocity", "acceleration")
]
SIZES = [
    {"max_acceleration": 0.4},
    {"max_speed": 1.5, "max_acceleration": 4.0},
    {"radius": 0.05, "max_speed": 0.2, "max_acceleration": 1.0},
]
HORIZON = preset("warehouse").horizon
ROBOTS = [
    *(("coop_nav", 32, *solved(0.9), robot, 200) for robot in DRIVES),
    *(("coop_nav", 24, *solved(0.9), robot, 500) for robot in SIZES),
    *(
        ("warehouse", 40, {"success": 0.75}, {"robot_collisions": 0.1}, robot, HORIZON)
        for robot in DRIVES
    ),
]
MIXED = [
    ("transport", 10, *solved(0.8), {"radius": 0.09, "command": "acceleration"}),
    (
        "warehouse", 20, {"deliveries": 6.0}, {"robot_collisions": 0.1},
        {"radius": 0.08, "max_speed": 0.4},
    ),
]  # fmt: skip


def check(name: str, n_episodes: int, least: Any, most: Any, **changes: Any) -> None:
    spec = preset(name).with_updates(**changes)
    found = evaluate("scripted", spec, n_episodes=n_episodes, progress=False).metrics
    for metric, bound in least.items():
        assert found[metric].mean() >= bound, metric
    for metric, bound in most.items():
        assert found[metric].mean() <= bound, metric


@pytest.mark.parametrize("case", PRESETS)
def test_presets_are_solved(case: Any) -> None:
    check(*case)


@pytest.mark.parametrize("name", every(6, NAVIGATION))
def test_every_preset_of_navigation_is_solved(name: str) -> None:
    check(name, 16, *solved(0.8))


@pytest.mark.parametrize("case", ROBOTS)
def test_robots_of_every_drive_and_size_solve_them(case: Any) -> None:
    *expected, robot, horizon = case
    check(*expected, team=[{"count": 4, "robot": robot}], horizon=horizon)


@pytest.mark.parametrize("case", MIXED)
def test_robots_of_two_kinds_work_together(case: Any) -> None:
    *expected, robot = case
    check(*expected, team=[{"count": 2}, {"name": "small", "count": 2, "robot": robot}])
