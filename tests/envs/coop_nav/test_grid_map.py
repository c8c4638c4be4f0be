"""Maps: boxes cover exactly the walls, and starts and goals are in the largest free part."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmdata.envs.coop_nav.grid_map import largest_part, walls
from swarmdata.errors import SpecError
from swarmdata.registry.components import make_env, make_policy
from swarmdata.rollouts.rollout import rollout
from swarmdata.specs.state_layout import TX, TY, X, Y, robots_of
from swarmdata.specs.task_spec import TaskSpec
from tests.envs.worlds import NO_OBSTACLES

MAZE = ("@@@@@@@", "@..@..@", "@.@@..@", "@.....@", "@@@@@.@", ".@@@@@@")

MAPS = st.integers(1, 8).flatmap(
    lambda n: st.lists(st.text(".@", min_size=n, max_size=n), min_size=1, max_size=8)
)


def spec_of(rows: tuple[str, ...] = MAZE, cell: float = 0.7, **changes: Any) -> TaskSpec:
    document = {
        "rules": {"task": "coop_nav", "arrangement": {"kind": "map", "rows": rows, "cell": cell}},
        "arena": {"width": cell * len(rows[0]), "height": cell * len(rows)},
        "obstacles": NO_OBSTACLES,
        "team": [{"count": 2}],
        **changes,
    }
    return TaskSpec.parse(document, "test")


@given(rows=MAPS)
def test_boxes_cover_every_wall_once_and_nothing_else(rows: list[str]) -> None:
    free = largest_part(rows)
    n_rows, n_columns = free.shape
    covered = np.zeros(free.shape, int)
    for _, x, y, _, _, half_x, half_y, _ in walls(rows, 1.0):
        left, top = round(x - half_x + n_columns / 2), round(n_rows / 2 - y - half_y)
        covered[top : top + round(2 * half_y), left : left + round(2 * half_x)] += 1
    assert (covered == ~free).all()


@given(rows=MAPS)
def test_the_largest_part_is_connected_and_no_other_is_larger(rows: list[str]) -> None:
    free = np.array([list(row) for row in rows]) == "."
    best = 0
    left = {(int(i), int(j)) for i, j in np.argwhere(free)}
    while left:
        part, edge = set(), {left.pop()}
        while edge:
            part |= edge
            near = {(i + a, j + b) for i, j in edge for a, b in ((0, 1), (1, 0), (0, -1), (-1, 0))}
            edge = near & left
            left -= edge
        best = max(best, len(part))
        if part & {(int(i), int(j)) for i, j in np.argwhere(largest_part(rows))}:
            assert part == {(int(i), int(j)) for i, j in np.argwhere(largest_part(rows))}
    assert largest_part(rows).sum() == best


def test_episodes_are_in_the_largest_part_and_solvable() -> None:
    spec = spec_of(horizon=200)
    free, env = largest_part(MAZE), make_env(spec, 4)
    assert not free[5, 0]
    seeds = np.arange(4, dtype=np.uint64)
    for episode in rollout(env, make_policy("scripted", spec), seeds):
        robots = robots_of(episode.states[0], 2)
        for x, y in ((X, Y), (TX, TY)):
            rows = (len(MAZE) / 2 - robots[:, y] / 0.7).astype(int)
            columns = (robots[:, x] / 0.7 + len(MAZE[0]) / 2).astype(int)
            assert free[rows, columns].all()
        assert episode.terminations[-1]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"arena": {"width": 4.0, "height": 4.0}}, "expected 4.9 m x 4.2 m"),
        ({"obstacles": {**NO_OBSTACLES, "circles": 1}}, "layout is fixed"),
        ({"cell": 0.6}, "cell is 0.6 m, expected at least 0.64 m"),
        ({"team": [{"count": 5}]}, "13 free cells, expected at least 20 for 5 robots"),
        ({"rows": ("..", "...")}, "different lengths"),
        ({"rows": ("x.",)}, "rows"),
    ],
)
def test_what_does_not_fit_is_refused(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(SpecError, match=words):
        make_env(spec_of(**changes), 1)
