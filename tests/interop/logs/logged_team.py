"""Logs of two robots that drive circles and lines, as tables and with a map."""

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from swarmdata.specs.origins.log_map import LogMap

RATE = 20.0  # Hz
SPEED, TURN = 0.4, 0.5  # m/s, rad/s


def bounded(**largest: float) -> list[dict[str, Any]]:
    """Components of a command, by their columns and the largest values."""
    return [{"column": name, "low": -most, "high": most} for name, most in largest.items()]


MAP: dict[str, Any] = {
    "dt": 0.1,
    "each": {
        "log": "{robot}.csv",
        "time": {"column": "t"},
        "pose": {"heading": {"column": "yaw", "unit": "deg"}},
        "command": {"components": bounded(v=0.5, omega=1)},
    },
    "robots": ["anna", "bert"],
}


def log_map(**changes: Any) -> LogMap:
    return LogMap.parse({**MAP, **changes})


def each(**changes: Any) -> dict[str, Any]:
    return {**MAP["each"], **changes}


def drive(seconds: float, phase: float = 0.0) -> dict[str, np.ndarray]:
    """A robot on a circle, with its commands, at `RATE`."""
    t = np.arange(round(seconds * RATE)) / RATE
    yaw = phase + TURN * t
    return {
        "t": 1000.0 + t,
        "x": SPEED / TURN * np.sin(yaw),
        "y": -SPEED / TURN * np.cos(yaw),
        "yaw": np.rad2deg(np.angle(np.exp(1j * yaw))),
        "v": np.full(len(t), SPEED) * (1 + 0.1 * np.sin(3 * t + phase)),
        "omega": np.full(len(t), TURN),
    }


def write_csv(path: Path, columns: Mapping[str, Sequence[Any] | np.ndarray]) -> Path:
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        writer.writerows(zip(*columns.values(), strict=True))
    return path


def write_team(folder: Path, seconds: float = 60.0) -> list[Path]:
    """One file for each robot."""
    return [
        write_csv(folder / "anna.csv", drive(seconds)),
        write_csv(folder / "bert.csv", drive(seconds, 1.0)),
    ]
