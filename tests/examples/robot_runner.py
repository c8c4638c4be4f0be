"""Runs an exported policy on one robot: numpy and onnxruntime, without swarmdata, torch or ROS.

    runner = Runner("policy.onnx", "robot_2")
    runner.drive(measure, send, seconds=30)

`measure()` returns the robot's observation, by the names in `runner.features`; `send` takes what
the motors should do. Every episode begins with `runner.forget()`. However the drive ends, the robot
is stopped.
"""

import json
import time
from collections.abc import Callable, Mapping

import numpy as np
import onnxruntime


class Runner:
    def __init__(self, path: str, robot: str) -> None:
        self._session = onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"])
        known = json.loads(self._session.get_modelmeta().custom_metadata_map["swarmdata"])
        spec = known["spec"]
        bodies = [role["robot"] for role in spec["team"] for _ in range(role["count"])]
        self.number = known["robots"].index(robot)
        self.features: list[str] = known["features"]
        self.time_step: float = spec["control_dt"]  # s
        self._body, self._size = bodies[self.number], known["memory"]
        self.forget()

    def forget(self) -> None:
        """Empties the memory: a new episode begins."""
        self._memory = np.zeros((1, self._size), np.float32)

    def act(self, measured: Mapping[str, float]) -> np.ndarray:
        """Returns the action, in [-1, 1]; call it once every time step."""
        row = np.array([[measured[name] for name in self.features]], np.float32)
        if not np.isfinite(row).all():
            bad = [
                name for name, x in zip(self.features, row[0], strict=True) if not np.isfinite(x)
            ]
            raise ValueError(f"{', '.join(bad)} is NaN or infinite: the robot stops")
        inputs = {"observation": row, "robot": np.array([self.number])}
        if not self._size:
            return self._session.run(["action"], inputs)[0][0]
        inputs["memory"] = self._memory
        action, self._memory = self._session.run(["action", "next_memory"], inputs)
        return action[0]

    def command(self, action: np.ndarray) -> tuple[float, float]:
        """Returns what the action means: (vx, vy) in the world or (v, omega), in SI units.

        Where robots are commanded by accelerations, it is an acceleration instead of a speed.
        """
        is_speed = self._body["command"] == "velocity"
        most = self._body["max_speed" if is_speed else "max_acceleration"]
        if self._body["dynamics"] == "unicycle":
            return most * float(action[0]), self._body["max_turn_rate"] * float(action[1])
        return most * float(action[0]), most * float(action[1])

    def drive(
        self,
        measure: Callable[[], Mapping[str, float]],
        send: Callable[[tuple[float, float]], None],
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
        if stop is None and self._body["command"] != "velocity":
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
            stop() if stop else send((0.0, 0.0))
