"""Clock offsets that were put into logs are found, and refused where the logs do not show them."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from swarmdata.errors import ConversionError, SpecError
from swarmdata.interop.logs.import_logs import import_logs, remake_logs
from swarmdata.specs.origins.log_map import LogMap
from swarmdata.specs.origins.log_origin import ImportedLogs
from tests.interop.logs.logged_team import bounded, write_csv
from tests.support.pairs import slow

DT, RATE, ROBOTS = 0.1, 50.0, ("anna", "bert")
OFFSETS = {"anna": 0.0, "bert": 0.237}
ID = "hall-clocks-v0"


def drive(seconds: float, seed: int, noise: float = 0.0, hold: float = 0.7) -> tuple[Any, Any]:
    """Poses at 50 Hz of a robot that follows commands at once; the commands change now and then."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(seconds * RATE)) / RATE
    switches = np.cumsum(rng.exponential(hold, 4000))
    values = np.stack([rng.uniform(-0.4, 0.5, 4001), rng.uniform(-1, 1, 4001)], axis=1)
    commands = values[np.searchsorted(switches, t, side="right")]
    yaw = np.append(0.0, np.cumsum(commands[:-1, 1] / RATE))
    ahead = np.stack([np.cos(yaw), np.sin(yaw)], axis=1) * commands[:, :1] / RATE
    places = np.append(np.zeros((1, 2)), np.cumsum(ahead[:-1], axis=0), axis=0)
    places += rng.normal(0, noise, places.shape)
    x, y = places.T
    poses = {"t": t, "x": x, "y": y, "yaw": yaw + rng.normal(0, noise, len(t))}
    return poses, {"t": t, "v": commands[:, 0], "omega": commands[:, 1]}


def write(folder: Path, change: Any = None, **options: Any) -> list[Path]:
    """Poses of both robots on one clock; the commands of each on the robot's own, which is slow."""
    paths = []
    for k, name in enumerate(ROBOTS):
        poses, commands = drive(60.0, k, **options)
        if change is not None:
            commands = change(commands)
        commands = {**commands, "t": commands["t"] - OFFSETS[name]}
        paths.append(write_csv(folder / f"{name}-poses.csv", poses))
        paths.append(write_csv(folder / f"{name}.csv", commands))
    return paths


def clock_map(**changes: Any) -> LogMap:
    command = {
        "log": "{robot}.csv",
        "clock_offset": "estimate",
        "components": bounded(v=1, omega=2),
        **changes.pop("command", {}),
    }
    pose = {"log": "{robot}-poses.csv", "heading": "yaw"}
    each = {"time": "t", "pose": pose, "command": command}
    content = {"dt": DT, "each": each, "robots": list(ROBOTS), "episodes": {"length": 5.0}}
    return LogMap.parse({**content, **changes})


def make(folder: Path, logs: list[Path], log_map: LogMap | None = None) -> Any:
    return import_logs(logs, folder / "dataset", log_map=log_map or clock_map(), id=ID)


@pytest.mark.parametrize("noise", slow(0.002, 0.0))
def test_known_offsets_are_found(tmp_path: Path, noise: float) -> None:
    logs = write(tmp_path, noise=noise)
    dataset = make(tmp_path, logs)
    origin = dataset.recipe
    assert isinstance(origin, ImportedLogs)
    assert [clock.robot for clock in origin.clocks] == list(ROBOTS)
    for clock in origin.clocks:
        error = abs(clock.offset - OFFSETS[clock.robot])
        assert error < DT / 5, clock
        assert error < 4 * clock.uncertainty + DT / 50, clock
        assert clock.uncertainty < DT / 5
        assert clock.explained > 0.7
    assert "The clock of bert's commands was estimated" in dataset.card
    again = remake_logs(logs, tmp_path / "again", origin)
    assert again.digest == dataset.digest


@pytest.mark.slow
def test_the_offset_is_added_to_the_times_of_commands(tmp_path: Path) -> None:
    logs = write(tmp_path)[2:]
    found = make(tmp_path, logs, clock_map(robots=["bert"]))
    (clock,) = found.recipe.clocks
    given, plain = (
        make(
            tmp_path / str(offset),
            logs,
            clock_map(command={"clock_offset": offset}, robots=["bert"]),
        )
        for offset in (clock.offset, 0.0)
    )
    assert_array_equal(found[3].actions, given[3].actions)
    assert_array_equal(found[3].observations, given[3].observations)
    assert plain[3].actions.shape == given[3].actions.shape
    assert (plain[3].actions != given[3].actions).any()


def constant(commands: dict[str, Any]) -> dict[str, Any]:
    return {**commands, "v": np.full(len(commands["t"]), 0.3), "omega": commands["omega"] * 0}


def of_others(commands: dict[str, Any]) -> dict[str, Any]:
    return {**drive(60.0, 99)[1], "t": commands["t"]}


@pytest.mark.parametrize(
    ("change", "words"),
    [(constant, "never change"), (of_others, "at no offset up to 5 s do commands explain")],
)
def test_logs_that_do_not_show_it_are_refused(tmp_path: Path, change: Any, words: str) -> None:
    with pytest.raises(ConversionError, match=words):
        make(tmp_path, write(tmp_path, change))


def test_commands_that_repeat_are_refused(tmp_path: Path) -> None:
    t = np.arange(3000) / RATE
    omega = np.sign(np.sin(2 * np.pi * t / 2.0))
    yaw = np.append(0.0, np.cumsum(omega[:-1] / RATE))
    poses = write_csv(tmp_path / "anna-poses.csv", {"t": t, "x": t * 0, "y": t * 0, "yaw": yaw})
    commands = write_csv(tmp_path / "anna.csv", {"t": t, "v": t * 0, "omega": omega})
    with pytest.raises(ConversionError, match="fit almost alike"):
        make(tmp_path, [poses, commands], clock_map(robots=["anna"]))
    narrow = make(tmp_path, [poses, commands], clock_map(robots=["anna"], clock_search=0.8))
    assert abs(narrow.recipe.clocks[0].offset) < DT / 10


def test_unknown_commands_have_no_offset() -> None:
    with pytest.raises(SpecError, match="needs to know what is commanded"):
        clock_map(command={"components": bounded(left=1)})
    with pytest.raises(SpecError, match="needs logged commands"):
        clock_map(command={"differences": True})
