"""Spec files with a map: of the map's size, and clear about what is wrong with it."""

from pathlib import Path

import pytest

from swarmdata.envs.coop_nav.navigation_rules import GridMap, NavigationRules
from swarmdata.errors import SpecError
from swarmdata.registry.presets import find_spec, preset

MAP = "type octile\nheight 2\nwidth 3\nmap\n.GT\nS@O\n"


def write(folder: Path, spec: str, content: str = MAP) -> Path:
    (folder / "x.map").write_text(content)
    (folder / "spec.yaml").write_text(spec)
    return folder / "spec.yaml"


def test_a_file_with_a_map_is_a_spec(tmp_path: Path) -> None:
    spec = find_spec(write(tmp_path, "map: x.map\n"))
    arrangement = spec.rules_as(NavigationRules).arrangement
    assert isinstance(arrangement, GridMap)
    assert arrangement.rows == ("..@", ".@@")
    assert (spec.arena.width, spec.arena.height) == pytest.approx((2.1, 1.4))
    assert spec.horizon == 70
    assert spec.team == preset("coop_nav").team


def test_other_fields_are_kept(tmp_path: Path) -> None:
    text = "map: x.map\ncell: 1\nhorizon: 9\nteam: [{count: 8}]\nrules: {goal_radius: 0.1}\n"
    spec = find_spec(write(tmp_path, text))
    assert (spec.arena.width, spec.horizon, spec.n_agents) == (3.0, 9, 8)
    assert spec.rules_as(NavigationRules).goal_radius == 0.1


@pytest.mark.parametrize(
    ("spec", "content", "words"),
    [
        ("map: y.map\n", MAP, r"the map .*y\.map cannot be read"),
        ("map: x.map\n", MAP.replace("T", "x"), "line 5, column 3 is 'x', expected one of"),
        ("map: x.map\nrules: {task: search}\n", MAP, "is of coop_nav, got the task 'search'"),
        ("map: 3\n", MAP, "map is 3"),
        ("map: x.map\ncell: wide\n", MAP, "cell 'wide'"),
        ("map: x.map\narena: {width: 3}\n", MAP, "has arena"),
        ("map: x.map\nrules: {arrangement: {kind: swap}}\n", MAP, "has an arrangement"),
        ("map: x.map\n", "height 2\n", "is no map"),
        ("map: x.map\n", MAP.replace("height 2", "height two"), "is no map"),
        ("map: x.map\n", MAP.replace("height 2", "height 3"), "2 rows, expected 3"),
        ("map: x.map\n", MAP.replace("S@O", "S@"), "line 6 has 2 cells, expected 3"),
        ("map: x.map\nteam: [{cuont: 8}]\n", MAP, "cuont"),
    ],
)
def test_mistakes_are_named(tmp_path: Path, spec: str, content: str, words: str) -> None:
    with pytest.raises(SpecError, match=words):
        find_spec(write(tmp_path, spec, content))
