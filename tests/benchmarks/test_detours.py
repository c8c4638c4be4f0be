"""Where policies push: sides of the payload, and directions there."""

import numpy as np
import pytest

pytest.importorskip("torch", reason="policies need the torch extra")

from swarmdata.interfaces import Policy
from swarmdata.registry.presets import preset
from swarmdata.rollouts.function_policy import FunctionPolicy
from swarmdata.specs.state_layout import N_COLUMNS, TX, TY, X, Y
from swarmdata.types import Double
from tests.benchmarks.bench_detours import HEAD, places, reach_of, shares, shown, watched

TRANSPORT = preset("transport")
REACH = reach_of(TRANSPORT)


def state(*robots: tuple[float, float]) -> Double:
    """The payload at (1, 1), its goal at (3, 1), robots around it."""
    row = np.zeros((len(robots), N_COLUMNS))
    for robot, (x, y) in zip(row, robots, strict=True):
        robot[[X, Y, TX, TY]] = 1 + x, 1 + y, 3, 1
    return np.concatenate([row.ravel(), [1.0, 1.0, 0, 0, 1, 0, 0]])[None]


def constant(x: float, y: float) -> Policy:
    return FunctionPolicy(lambda seen: np.broadcast_to([x, y], (*seen.shape[:2], 2)))


def test_robots_are_in_front_beside_behind_or_away() -> None:
    found = places(state((0.45, 0.1), (0, -0.45), (-0.45, 0), (-1, 1)), 4, REACH)
    where = {name: rows[0].tolist().index(True) for name, rows in found.regions.items()}
    assert where == {"in front": 0, "beside": 1, "behind": 2, "away from it": 3}
    assert tuple(found.regions) == HEAD[1:]
    assert sum(rows.sum() for rows in found.regions.values()) == 4
    np.testing.assert_allclose(found.along[0], np.tile([1.0, 0.0], (4, 1)))


def test_the_way_around_leads_behind_the_payload() -> None:
    sides = state((0.3, 0.3), (0.0, -0.4), (-0.3, -0.3))
    found = places(sides, 3, REACH)
    diagonal = np.sqrt(0.5)
    expected = [[-diagonal, diagonal], [-1, 0], [-diagonal, diagonal]]
    np.testing.assert_allclose(found.around[0], expected, atol=1e-9)


def test_parts_are_of_the_clone_and_of_differences_to_it() -> None:
    found = places(state((0.45, 0), (0, -0.45), (-0.45, 0), (-1, 1)), 4, REACH)
    commands = np.array([[0.5, 0.0], [0.2, 0.3]])[:, None, None].repeat(4, axis=2)
    along, around = shares(found, commands)  # [regions, P]
    np.testing.assert_allclose(along, [[0.5, -0.3]] * 4)
    beside = HEAD[1:].index("beside")
    np.testing.assert_allclose(around[beside], [-0.5, 0.3])


def test_commands_are_compared_in_the_states_of_the_clone() -> None:
    states, commands = watched(TRANSPORT, [constant(0.1, 0.0), constant(0.0, -0.2)], 2)
    assert commands.shape == (2, len(states), TRANSPORT.n_agents, 2)
    np.testing.assert_allclose(commands[0, ..., 0], 0.1, rtol=1e-6)
    np.testing.assert_allclose(commands[1, ..., 1], -0.2, rtol=1e-6)


def test_means_are_bold_where_seeds_agree() -> None:
    assert shown(np.array([0.1, 0.3])) == "**+0.200**"
    assert shown(np.array([-0.1, 0.3])) == "+0.100"
