"""Policy: what a robot computes in one step, with Python and NumPy alone.

    policy = Policy()
    action, memory = policy.step(observation, robot=2, memory=memory)

Files of `swarmdata export-policy RUN policy.py` are this code, with the policy in `DATA`: the
frame, the normalization, the network and its memory as a list of operations on arrays.
"""

import base64
import io
import json
from typing import Any

import numpy as np


def _tuple(axes: Any) -> Any:
    return None if axes is None else tuple(axes)


def _log_softmax(x: Any, axis: int) -> Any:
    below = x - x.max(axis, keepdims=True)
    return below - np.log(np.exp(below).sum(axis, keepdims=True))


def _layer_norm(x: Any, scale: Any, shift: Any, epsilon: float) -> Any:
    centered = x - x.mean(-1, keepdims=True)
    return centered / np.sqrt((centered**2).mean(-1, keepdims=True) + epsilon) * scale + shift


def _scatter(x: Any, axis: int, index: Any, values: Any) -> Any:
    changed = x.copy()
    np.put_along_axis(changed, index, values, axis)
    return changed


OPERATIONS: Any = {
    "add": np.add, "sub": np.subtract, "mul": np.multiply, "div": np.divide,
    "eq": np.equal, "lt": np.less, "gt": np.greater, "ge": np.greater_equal,
    "bitwise_and": np.bitwise_and, "logical_not": np.logical_not, "where": np.where,
    "sqrt": np.sqrt, "tanh": np.tanh, "floor": np.floor, "bmm": np.matmul,
    "relu": lambda x: np.maximum(x, 0), "sigmoid": lambda x: 0.5 + 0.5 * np.tanh(0.5 * x),
    "clamp": lambda x, low=None, high=None: np.clip(x, low, high),
    "astype": lambda x, dtype: x.astype(dtype),
    "broadcast": np.broadcast_to, "reshape": np.reshape, "unsqueeze": np.expand_dims,
    "squeeze": lambda x, axes: np.squeeze(x, _tuple(axes)),
    "permute": np.transpose, "cat": lambda parts, axis=0: np.concatenate(parts, axis),
    "select": lambda x, axis, k: np.take(x, k, axis),
    "index": lambda x, places: x[tuple(slice(None) if p is None else p for p in places)],
    "slice": lambda x, axis, a, b: x.swapaxes(0, axis)[a:b].swapaxes(0, axis),
    "split": lambda x, sizes, axis=0: np.split(x, np.cumsum(sizes)[:-1], axis),
    "item": lambda parts, k: parts[k],
    "gather": lambda x, axis, index: np.take_along_axis(x, index, axis), "scatter": _scatter,
    "sum": lambda x, axes=None, keep=False: np.sum(x, _tuple(axes), keepdims=keep),
    "mean": lambda x, axes=None, keep=False: np.mean(x, _tuple(axes), keepdims=keep),
    "amax": lambda x, axes=None, keep=False: np.amax(x, _tuple(axes), keepdims=keep),
    "any": lambda x, axes=None, keep=False: np.any(x, _tuple(axes), keepdims=keep),
    "argmax": lambda x, axis=None, keep=False: np.argmax(x, axis, keepdims=keep),
    "log_softmax": _log_softmax, "softmax": lambda x, axis: np.exp(_log_softmax(x, axis)),
    "layer_norm": _layer_norm,
}  # fmt: skip


class Policy:
    """The policy of one training seed, for every robot of the team; `about` is what it is for."""

    def __init__(self) -> None:
        content = io.BytesIO(base64.b64decode(DATA))
        with np.load(content, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        self.about = json.loads(str(arrays.pop("about")))
        self._calls, self._outputs = json.loads(str(arrays.pop("program")))
        self._constants = {
            name: x.astype(np.float64) if x.dtype.kind == "f" else x for name, x in arrays.items()
        }

    def step(self, observation: Any, robot: int, memory: Any = ()) -> Any:
        """Returns action, float32 [A], and next memory, float32 [M].

        Args:
            observation: of the robot, [O], by the names in `about["features"]`.
            robot: its number in the team.
            memory: of the step before, [M]; zeros when an episode begins.
        """
        values = dict(self._constants)
        values["%observation"] = np.array([observation], np.float32)
        values["%robot"] = np.array([robot], np.int64)
        values["%memory"] = np.array([memory], np.float32)

        def value(given: Any) -> Any:
            if isinstance(given, list):
                return [value(each) for each in given]
            is_name = isinstance(given, str) and given.startswith("%")
            return values[given] if is_name else given

        for result, operation, arguments in self._calls:
            values[result] = OPERATIONS[operation](*[value(each) for each in arguments])
        found = [np.asarray(values[name][0], np.float32) for name in self._outputs]
        return found[0], found[1] if self.about["memory"] else np.zeros(0, np.float32)


DATA = ""
