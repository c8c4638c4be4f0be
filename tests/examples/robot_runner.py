"""Runs an exported policy on one robot, without swarmdata, torch or ROS.

    runner = Runner("policy.py", "robot_2")  # with NumPy alone; "policy.onnx" with onnxruntime
    runner.drive(measure, send, seconds=30)

`measure()` returns the robot's observation, by the names in `runner.features`; `send` takes what
the motors should do. Every episode begins with `runner.forget()`. However the drive ends, the robot
is stopped.
"""

import json
import runpy
import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np


class OnnxPolicy:
    """A policy of a file of ONNX, as the class `Policy` of a file of Python."""

    def __init__(self, path: str) -> None:
        import onnxruntime

        self._session = onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"])
        self.about = json.loads(self._session.get_modelmeta().custom_metadata_map["swarmdata"])

    def step(self, observation: Any, robot: int, memory: Any) -> Any:
        inputs = {"observation": observation[None], "robot": np.array([robot])}
        if not self.about["memory"]:
            return self._session.run(["action"], inputs)[0][0], memory
        inputs["memory"] = memory[None]
        return [each[0] for each in self._session.run(["action", "next_memory"], inputs)]


class Runner:
    def __init__(self, path: str, robot: str) -> None:
        is_onnx = path.endswith(".onnx")
        self._policy = OnnxPolicy(path) if is_onnx else runpy.run_path(path)["Policy"]()
        about = self._policy.about
        self.number = about["robots"].index(robot)
        self.features: list[str] = about["features"][robot]
        self.time_step: float = about["time_step"]  # s
        self._size = max(map(len, about["features"].values()))
        self._command, self._n_memory = about["commands"][self.number], about["memory"]
        self.forget()

    def forget(self) -> None:
        """Empties the memory: a new episode begins."""
        self._memory = np.zeros(self._n_memory, np.float32)

    def act(self, measured: Mapping[str, float]) -> np.ndarray:
        """Returns the action, in [-1, 1]; call it once every time step.

        Raises:
            ValueError: a number of the observation or of the action is NaN or infinite.
        """
        row = np.zeros(self._size, np.float32)  # of robots that observe less, the rest is 0
        row[: len(self.features)] = [measured[name] for name in self.features]
        if not np.isfinite(row).all():
            bad = [self.features[k] for k in np.flatnonzero(~np.isfinite(row))]
            raise ValueError(f"{', '.join(bad)} is NaN or infinite: the robot stops")
        action, memory = self._policy.step(row, self.number, self._memory)
        if not (np.isfinite(action).all() and np.isfinite(memory).all()):
            raise ValueError(f"the policy's action is {action}: the robot stops")
        self._memory = memory
        return action

    def command(self, action: np.ndarray) -> tuple[float, ...]:
        """Returns what the action means, in SI units, limited as in the training.

        That is (vx, vy) in the world or (v, omega); accelerations where robots are commanded by
        them; of policies that learned from logs, what was logged.
        """
        norm = self._command["norm"]
        if norm is not None:
            action = action / max(1.0, float(np.linalg.norm(action[:2], norm)))
        columns = zip(self._command["middle"], self._command["half"], action, strict=False)
        return tuple(middle + half * float(x) for middle, half, x in columns)

    def drive(
        self,
        measure: Callable[[], Mapping[str, float]],
        send: Callable[[tuple[float, ...]], None],
        seconds: float,
        stop: Callable[[], None] | None = None,
    ) -> None:
        """Acts at the rate of the training, and stops the robot at the end and on any error.

        After a step that took too long, the next one begins a whole step later: no command is sent
        sooner to catch up.

        Args:
            measure: the robot's sensors; ValueError if a number is NaN or infinite.
            send: commands its motors.
            seconds: length of the drive.
            stop: stops it; by default a command of zero, which stops no robot that is commanded by
                accelerations.
        """
        still = self._command["stop"]
        if stop is None and still is None:
            raise ValueError("a command of zero does not stop this robot, so pass `stop`")
        due = time.monotonic()
        try:
            for _ in range(round(seconds / self.time_step)):
                send(self.command(self.act(measure())))
                due, now = due + self.time_step, time.monotonic()
                if now > due:
                    due = now + self.time_step
                time.sleep(due - now)
        finally:
            stop() if stop else send(tuple(still))
