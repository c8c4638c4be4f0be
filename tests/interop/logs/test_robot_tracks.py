"""Units, frames and clocks that cannot be right are said, and those that can be are not."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmdata.interop.logs.import_logs import import_logs
from tests.interop.logs.logged_team import bounded, drive, each, log_map, write_csv

RIGHT: dict[str, dict[str, float]] = {"as they are": {}, "a slow robot": {"v": 2.0}}

WRONG = {
    "millimetres": ({"x": 1000.0, "y": 1000.0}, "anna moves at 1e.03 times its command v;"),
    "centimetres": ({"x": 100.0, "y": 100.0}, "anna moves at 1e.02 times its command v;"),
    "radians as degrees": ({"yaw": np.pi / 180}, "anna moves at 0.017 times its command omega;"),
    "turns the other way": ({"omega": -1.0}, "anna moves at -1 times its command omega;"),
    "percent": ({"v": 100.0}, "anna moves at 0.01 times its command v;"),
}
"""Factors of columns of one robot, and what is said."""


def told(
    folder: Path, caplog: pytest.LogCaptureFixture, scales: dict[str, float], late: float = 0.0
) -> list[str]:
    """What is said of a team, one of whose robots has scaled columns, or a clock that is late."""
    columns = drive(60.0)
    columns |= {name: columns[name] * scale for name, scale in scales.items()}
    columns["t"] = columns["t"] + late
    others = drive(60.0, 1.0)
    logs = [write_csv(folder / "anna.csv", columns), write_csv(folder / "bert.csv", others)]
    components: dict[str, Any] = {"components": bounded(v=50.0, omega=1.0)}
    given = log_map(each=each(command=components), episodes={"length": 2.0})
    import_logs(logs, folder / "out", log_map=given, id="hall-monday-v0")
    return [record.getMessage() for record in caplog.records if record.name == "swarmdata"]


@pytest.mark.parametrize("name", WRONG)
def test_what_a_robot_cannot_do_is_said(
    name: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    scales, message = WRONG[name]
    said = told(tmp_path, caplog, scales)
    assert any(re.search(message, each) for each in said), said
    assert not any("bert" in each for each in said)


@pytest.mark.parametrize("name", RIGHT)
def test_what_a_robot_can_do_is_not(
    name: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    assert told(tmp_path, caplog, RIGHT[name]) == []


def test_robots_that_are_never_there_together(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (said,) = told(tmp_path, caplog, {}, late=1000.0)
    assert "at no time are anna, bert all there; check their clocks" in said


def test_a_robot_without_commands_is_said_to_be_never_there(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (said,) = told(tmp_path, caplog, {"v": np.nan})
    assert "anna is never there: at no time are its pose and its command both known" in said
