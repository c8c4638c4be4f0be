"""Robots that our own simulator drives with known gains, lags and delays, and their logs."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

import swarmdata
from swarmdata.interop.logs.logged_drives import Drives, Response
from swarmdata.specs.origins.log_map import LogMap
from swarmdata.specs.task_spec import TaskSpec
from tests.interop.logs.logged_team import bounded, write_csv

DT = 0.1  # s
LARGEST = (0.4, 1.0)  # m/s, rad/s, of commands
NAMES = ("anna", "bert")


def random_commands(n_steps: int, seed: int, n_robots: int = len(NAMES)) -> np.ndarray:
    """Commands that change about each second, [n_steps, N, 2]."""
    rng = np.random.default_rng(seed)
    found = np.empty((n_steps, n_robots, 2))
    for n in range(n_robots):
        begins = np.cumsum(rng.integers(3, 18, n_steps))
        piece = np.searchsorted(begins, np.arange(n_steps), side="right")
        levels = np.stack([rng.uniform(0, 0.4, n_steps), rng.uniform(-1, 1, n_steps)], axis=1)
        found[:, n] = levels[piece]
    return found


def simulated(responses: Sequence[Response]) -> TaskSpec:
    """Robots with these responses, which drive through everything."""
    robots = (
        {
            "dynamics": "unicycle",
            "max_speed": each.speed_gain * LARGEST[0],
            "max_turn_rate": each.turn_gain * LARGEST[1],
            "max_acceleration": 20.0,
            "wheel_grip": 100.0,
            "actuator_lag": each.lag,
            "command_delay": each.delay,
        }
        for each in responses
    )
    team = [{"name": f"kind{k}", "count": 1, "robot": robot} for k, robot in enumerate(robots)]
    return TaskSpec.parse(
        {"team": team, "backend": "kinematic", "horizon": 100_000, "control_dt": DT,
         "physics_dt": DT / 2, "obstacles": {"circles": 0, "boxes": 0, "corners": 0, "pockets": 0}}
    )  # fmt: skip


def played(spec: TaskSpec, commands: np.ndarray) -> np.ndarray:
    """Poses x, y and heading under commands [T, N, 2], [T+1, N, 3]."""
    env = swarmdata.make_env(spec, n_copies=1)
    step = env.reset(np.zeros(1, np.uint64))
    poses = [_poses(step.states[0], len(spec.robots))]
    for each in commands:
        step = env.step((each / LARGEST).astype(np.float32)[None])
        assert not (step.terminations | step.truncations).any()
        poses.append(_poses(step.states[0], len(spec.robots)))
    return np.stack(poses)


def _poses(state: np.ndarray, n: int) -> np.ndarray:
    rows = state[: 8 * n].reshape(n, 8).astype(np.float64)
    return np.column_stack([rows[:, 0], rows[:, 1], np.arctan2(rows[:, 5], rows[:, 4])])


def drives_of(poses: np.ndarray, commands: np.ndarray) -> Drives:
    """One long drive of every robot."""
    T, N = commands.shape[:2]
    return Drives(
        names=tuple(f"kind{k}" for k in range(N)),
        dt=DT,
        largest=LARGEST,
        poses=poses.swapaxes(0, 1)[None],
        commands=commands.swapaxes(0, 1)[None],
        known=np.ones((1, N, T), np.bool_),
    )


MAP: dict[str, Any] = {
    "dt": DT,
    "each": {
        "log": "{robot}.csv",
        "time": "t",
        "pose": {"heading": "yaw"},
        "command": {"components": bounded(v=LARGEST[0], omega=LARGEST[1])},
    },
    "robots": list(NAMES),
    "episodes": {"length": 10},
}


def log_map(**changes: Any) -> LogMap:
    """The map of their logs."""
    return LogMap.parse({**MAP, **changes})


def write_logs(
    folder: Path, poses: np.ndarray, commands: np.ndarray, without: slice = slice(0, 0)
) -> list[Path]:
    """One table of each robot; the rows `without` of the second one are missing."""
    folder.mkdir(parents=True, exist_ok=True)
    found = []
    for n, name in enumerate(NAMES):
        columns = {
            "t": np.arange(len(commands)) * DT,
            **dict(zip(("x", "y", "yaw"), poses[:-1, n].T, strict=True)),
            **dict(zip(("v", "omega"), commands[:, n].T, strict=True)),
        }
        if n == 1:
            kept = np.delete(np.arange(len(commands)), without)
            columns = {key: values[kept] for key, values in columns.items()}
        found.append(write_csv(folder / f"{name}.csv", columns))
    return found
