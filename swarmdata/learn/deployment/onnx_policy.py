"""A team whose robots all run one file of ONNX, of this library or another."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from swarmdata.errors import CheckpointError
from swarmdata.rollouts.action_probabilities import LastMeans, certain_log_probs
from swarmdata.runtime.extras import require_extra
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Float, Int, Step


class OnnxPolicy:
    """Implements `interfaces.Policy`. Inputs and outputs of the file are those of `export_onnx`.

    Args:
        path: of the file, which must hold all its weights.

    Raises:
        MissingExtraError: onnxruntime is not installed.
        OSError: the file cannot be read.
    """

    uses_state = False

    def __init__(self, path: Path, spec: TaskSpec) -> None:
        require_extra("onnxruntime", "onnx", "running a file of ONNX")
        import onnxruntime  # noqa: PLC0415  (an extra)

        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        try:  # from bytes, so that no file beside it is read
            self._session: Any = onnxruntime.InferenceSession(
                path.read_bytes(), options, providers=["CPUExecutionProvider"]
            )
        except OSError:
            raise
        except Exception as error:  # the runtime's exceptions have no other base
            raise CheckpointError(f"{path} is no network of ONNX: {error}") from error
        inputs = {each.name: each for each in self._session.get_inputs()}
        self._n_memory = inputs["memory"].shape[-1] if "memory" in inputs else 0
        self._outputs = ["action", "next_memory"] if "memory" in inputs else ["action"]
        self._path, self._with_robots = path, "robot" in inputs
        self._shape = spec.n_agents, spec.action_size
        self._check(inputs, spec.observation_size)
        self._memory = np.zeros((0, spec.n_agents, self._n_memory), np.float32)
        self._last = LastMeans[Float]()

    def _check(self, inputs: Mapping[str, Any], n_features: int) -> None:
        """Raises CheckpointError unless inputs and outputs are those of a robot of the task."""
        expected = {"observation": ("tensor(float)", n_features)}
        if self._with_robots:
            expected["robot"] = ("tensor(int64)", 0)
        if "memory" in inputs:
            expected["memory"] = ("tensor(float)", self._n_memory)
        found = {
            name: (each.type, 0 if name == "robot" else each.shape[-1])
            for name, each in inputs.items()
        }
        outputs = [each.name for each in self._session.get_outputs()]
        if found != expected or outputs != self._outputs or not isinstance(self._n_memory, int):
            raise CheckpointError(
                f"{self._path} has the inputs {found} and the outputs {outputs}, expected "
                f"{expected}, and perhaps robot (int64) and memory, and the outputs {self._outputs}"
            )

    def reset(self, step: Step, copies: Int) -> None:
        if len(self._memory) != len(step.observations):
            shape = (len(step.observations), *self._memory.shape[1:])
            self._memory = np.zeros(shape, np.float32)
        self._memory[copies] = 0.0

    def act(self, step: Step) -> Float:
        n_copies, n_robots, n_features = step.observations.shape
        inputs = {"observation": step.observations.reshape(-1, n_features)}
        if self._with_robots:
            inputs["robot"] = np.tile(np.arange(n_robots), n_copies)
        if self._n_memory:
            inputs["memory"] = self._memory.reshape(-1, self._n_memory)
        actions, *memory = self._session.run(self._outputs, inputs)
        if actions.shape != (n_copies * n_robots, self._shape[1]) or not np.isfinite(actions).all():
            raise CheckpointError(
                f"{self._path} answered with actions of shape {actions.shape}, expected finite "
                f"numbers, {n_copies * n_robots} x {self._shape[1]}"
            )
        if memory:
            self._memory = memory[0].reshape(self._memory.shape)
        joint: Float = actions.reshape(n_copies, *self._shape).clip(-1.0, 1.0).astype(np.float32)
        return self._last.keep(step, joint).copy()

    def log_probs(self, step: Step, actions: Float) -> Float:
        """Returns 0 for robots that take the policy's actions, else -infinity, [E, N]."""
        return certain_log_probs(self._last.require(step), actions)
