"""Tables whose rows are windows of several steps, with positions in pixels of an image."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from swarmdata.audit import audit
from swarmdata.errors import ConversionError, SpecError
from swarmdata.interop.logs.import_logs import import_logs, read_map
from swarmdata.specs.origins.log_map import LogMap
from tests.interop.logs.logged_team import write_csv

ROBOTS = ("H", "F1", "T")
N_WINDOWS, N_STEPS = 12, 26
SPEED, TURN = 0.08, 0.2  # m/s, rad/s


def poses(robot: int, window: int) -> np.ndarray:
    """x and y in m, y up, and the heading in rad, on a circle, [26, 3]."""
    heading = robot + window + TURN * 0.5 * np.arange(N_STEPS)
    circle = SPEED / TURN * np.stack([np.sin(heading), -np.cos(heading)], axis=1)
    return np.column_stack([1.0 + circle, heading])


def write_windows(path: Path) -> Path:
    """A look-alike of Thy-ReTLo: whole pixels, y down, degrees."""
    columns: dict[str, Any] = {}
    for step in range(N_STEPS):
        for number, robot in enumerate(ROBOTS):
            rows = np.array([poses(number, window)[step] for window in range(N_WINDOWS)])
            degrees = np.rad2deg(np.angle(np.exp(1j * rows[:, 2])))
            columns[f"{step}_{robot}_x"] = rows[:, 0] / 0.0033
            columns[f"{step}_{robot}_y"] = 600 - rows[:, 1] / 0.0033
            columns[f"{step}_{robot}_o"] = degrees
    return write_csv(path, columns)


@pytest.mark.slow
def test_each_window_is_an_episode(tmp_path: Path) -> None:
    log = write_windows(tmp_path / "Train.csv")
    dataset = import_logs(log, tmp_path / "data", log_map="retlo-3", id="retlo-alike-v0")
    assert audit(dataset.path, progress=False).problems == ()
    assert [len(episode) for episode in dataset] == [N_STEPS - 1] * N_WINDOWS
    for number in range(len(ROBOTS)):
        seen, expected = dataset[5].observations[:, number], poses(number, 5)
        assert_allclose(seen[:, 0], expected[:, 0], atol=1e-6)
        assert_allclose(seen[:, 1], expected[:, 1] - 600 * 0.0033, atol=1e-6)
        assert_allclose(seen[:, 2], np.cos(expected[:, 2]), atol=1e-6)
        actions = dataset[5].actions[:, number]
        assert_allclose(actions[:, 0], SPEED, rtol=0.01)  # a chord
        assert_allclose(actions[:, 1], TURN, rtol=1e-4)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("0_H_x", "note", "column 'note', expected columns of windows"),
        ("25_T_o", "27_T_o", "'T_o' has 26 steps from 0 to 27, expected 0 to 25"),
    ],
)
def test_columns_of_other_steps_are_refused(tmp_path: Path, old: str, new: str, words: str) -> None:
    log = write_windows(tmp_path / "Train.csv")
    log.write_text(log.read_text().replace(old, new, 1))
    with pytest.raises(ConversionError, match=words):
        import_logs(log, tmp_path / "data", log_map="retlo-3", id="retlo-alike-v0")


def test_windows_that_would_be_joined_are_refused() -> None:
    content = read_map("retlo-3").model_dump(mode="json")
    words = r"pause is 7 s, expected more than every `max_gap` \(8 s\)"
    with pytest.raises(SpecError, match=words):
        LogMap.parse({**content, "max_gap": 8.0})


@pytest.mark.parametrize("column", [{"unit": "px"}, {"unit": "px", "scale": 0}, {"scale": 0}])
def test_pixels_need_a_scale(column: dict[str, Any]) -> None:
    robot = {"name": "a", "pose": {"x": {"column": "x", **column}},
             "command": {"components": ["v"]}}  # fmt: skip
    with pytest.raises(SpecError, match=r"pixels \(unit: px\) need the metres of one"):
        LogMap.parse({"dt": 0.1, "robots": [robot]})
