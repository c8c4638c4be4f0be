"""Layouts are solvable: a robot fits from any start to any goal."""

import numpy as np
import pytest

from swarmdata.envs.coop_nav.navigation_rules import NavigationRules
from swarmdata.errors import SpecError
from swarmdata.numerics.geometry import clearance
from swarmdata.registry.components import make_env, make_task
from swarmdata.registry.presets import preset, preset_names
from swarmdata.specs.state_layout import N_COLUMNS, TX, UX, UY, VX, VY, Y, robots_of
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Bool, Double, Float
from tests.envs.worlds import ROUNDING, check_obstacles, check_places
from tests.support.pairs import every, slow


def free_grid(spec: TaskSpec, layout: Float, cell: float) -> tuple[Bool, Double]:
    """Which grid points a robot's centre can be at, and the grid's coordinates along one axis."""
    half = np.array([spec.arena.width / 2, spec.arena.height / 2])
    axis = np.arange(-half[0] + cell / 2, half[0], cell)
    radius = spec.robots[0].radius
    free = [[clearance(x, y, layout, half) >= radius for y in axis] for x in axis]
    return np.array(free), axis


def reachable(free: Bool, start: tuple[int, int]) -> Bool:
    """Flood fill over the four neighbours."""
    seen = np.zeros_like(free)
    stack = [start]
    while stack:
        x, y = stack.pop()
        if 0 <= x < len(free) and 0 <= y < len(free) and free[x, y] and not seen[x, y]:
            seen[x, y] = True
            stack += [(x + 1, y), (x - 1, y), (x, y + 1), (x, y - 1)]
    return seen


@pytest.mark.parametrize("first_seed", [2**62, *slow(0, 1000)])
def test_every_goal_is_reachable_from_every_start(first_seed: int) -> None:
    spec = TaskSpec()
    step = make_env(spec, 8).reset(np.arange(first_seed, first_seed + 8, dtype=np.uint64))
    for layout, state in zip(step.layouts, robots_of(step.states, 4), strict=True):
        free, axis = free_grid(spec, layout, 0.03)

        def cell(point: Float, axis: Double = axis) -> tuple[int, int]:
            return int(np.abs(axis - point[0]).argmin()), int(np.abs(axis - point[1]).argmin())

        seen = reachable(free, cell(state[0, :2]))
        assert all(seen[cell(row[:2])] and seen[cell(row[TX:])] for row in state)


PRESETS = [name for name in preset_names() if preset(name).rules.task != "intersection"]
"""Robots of an intersection stand in its gates."""


@pytest.mark.parametrize("name", every(4, PRESETS))
def test_robots_start_at_rest_where_the_spec_has_room(name: str) -> None:
    spec = preset(name)
    step = make_env(spec, 64).reset(np.arange(64, dtype=np.uint64))
    for layout, robots in zip(step.layouts, robots_of(step.states, spec.n_agents), strict=True):
        starts, s = robots[:, : Y + 1].astype(float), spec.spawn
        check_places(spec, layout, starts, s.start_clearance, s.start_separation)
        assert not robots[:, VX : VY + 1].any()
        np.testing.assert_allclose(np.hypot(robots[:, UX], robots[:, UY]), 1.0, atol=1e-6)
        if spec.obstacles.number:
            check_obstacles(spec, layout)
    headings = robots_of(step.states, spec.n_agents)[..., UX]  # drawn for unicycles, else +x
    for robot, column in zip(spec.robots, headings.T, strict=True):
        assert len(np.unique(column)) > 32 if robot.dynamics == "unicycle" else (column == 1).all()


RANDOM = [
    name
    for name in preset_names()
    if isinstance(rules := preset(name).rules, NavigationRules)
    and rules.arrangement.kind == "random"
]


@pytest.mark.parametrize("name", every(3, RANDOM))
def test_goals_keep_the_distances_of_the_spec(name: str) -> None:
    spec = preset(name)
    step, n, s = make_env(spec, 64).reset(np.arange(64, dtype=np.uint64)), spec.n_agents, spec.spawn
    for layout, state in zip(step.layouts, step.states, strict=True):
        robots = robots_of(state, n).astype(float)
        starts, goals = robots[:, : Y + 1], robots[:, TX:]
        if len(state) > N_COLUMNS * n:  # unassigned goals
            goals = state[N_COLUMNS * n :].reshape(n, 2).astype(float)
        check_places(spec, layout, goals, s.goal_clearance, s.goal_separation)
        assert np.linalg.norm(starts - goals, axis=-1).min() >= s.min_goal_distance - ROUNDING


def test_different_seeds_give_different_layouts() -> None:
    step = make_env(TaskSpec(), 64).reset(np.arange(64, dtype=np.uint64))
    assert len(np.unique(step.layouts.reshape(64, -1), axis=0)) == 64


@pytest.mark.parametrize("name", ["warehouse", "intersection", "coop_nav-swap", "coop_nav-ranks"])
def test_drawn_obstacles_are_refused_where_the_layout_is_fixed(name: str) -> None:
    with pytest.raises(SpecError, match=r"'circles': 1.*, whose layout is fixed"):
        make_task(preset(name).with_updates(obstacles={"circles": 1, "boxes": 0}))
