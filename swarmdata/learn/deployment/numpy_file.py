"""A policy of one seed as a file of Python, which a robot runs with NumPy alone.

torch traces the step of one robot. What does not depend on the robot's inputs is computed here; the
rest becomes a list of operations of `numpy_step`, whose code is the beginning of the file.
"""

import base64
import inspect
import io
import json
import textwrap
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.fx import Node

from swarmdata.errors import PolicyFitError
from swarmdata.interfaces import Policy
from swarmdata.learn.deployment import numpy_step
from swarmdata.learn.deployment.onnx_file import quiet
from swarmdata.learn.deployment.robot_step import RobotStep, description, fitting_step
from swarmdata.runtime.atomic import staged

Arguments = Sequence[Any]
Translation = tuple[str, Callable[[Arguments, Node], Arguments]]
"""The operation of `numpy_step` that stands for one of torch, and its arguments."""

EMPTY = 'DATA = ""\n'
"""Line of `numpy_step` that the policy takes the place of."""

LINE = 100
"""Characters of a line of the policy's data."""

CHECKS = ("_assert_async", "_assert_tensor_metadata")
"""Operations of torch that compute nothing."""


def export_numpy(
    policy: Policy,
    path: Path,
    *,
    robots: Sequence[str],
    features: Sequence[Sequence[str]],
    about: Mapping[str, Any],
) -> Path:
    """Writes a policy of one seed as a module with a class `Policy`.

    Its method `step` takes and returns what the network of `export_onnx` does, of one robot at a
    time and without the axis of rows. Arguments are those of `export_onnx`, too; `about` is in
    `Policy.about`.

    Raises:
        PolicyFitError: policies of this kind cannot be exported.
        ConversionError: `path` exists, or the observations are not those of the policy.
    """
    step = fitting_step(policy, path, features)
    known = description(step, robots, features, about)
    program = _Program(step)
    arrays: dict[str, Any] = {name: _small(each) for name, each in program.constants.items()}
    arrays["about"] = json.dumps(known)
    arrays["program"] = json.dumps([program.calls, program.outputs])
    content = io.BytesIO()
    np.savez_compressed(content, **arrays)
    code = inspect.getsource(numpy_step)
    assert code.endswith(EMPTY)
    data = "\n".join(textwrap.wrap(base64.b64encode(content.getvalue()).decode(), LINE))
    with staged(path) as target:
        target.write_text(f'{code.removesuffix(EMPTY)}DATA = """\n{data}\n"""\n', encoding="utf-8")
    return path


def _small(value: Tensor) -> Any:
    """The array, in float32 where that holds its numbers exactly."""
    array = value.detach().numpy()
    narrow = array.astype(np.float32) if array.dtype.kind == "f" else array
    return narrow if np.array_equal(narrow, array) else array


def _same(arguments: Arguments, node: Node) -> Arguments:
    return arguments


def _shaped(arguments: Arguments, node: Node) -> Arguments:
    """The first argument, and the shape of the result."""
    return [arguments[0], list(node.meta["val"].shape)]


def _cast(arguments: Arguments, node: Node) -> Arguments:
    return [arguments[0], str(node.meta["val"].dtype).removeprefix("torch.")]


def _normed(arguments: Arguments, node: Node) -> Arguments:
    """Without the shape that is normalized, which is the last axis of all networks."""
    values, _, scale, shift, epsilon = arguments
    return [values, scale, shift, epsilon]


SAME = (
    "add", "sub", "mul", "div", "eq", "lt", "gt", "ge", "bitwise_and", "logical_not", "where",
    "sqrt", "tanh", "floor", "bmm", "relu", "sigmoid", "clamp", "unsqueeze", "squeeze", "permute",
    "cat", "select", "index", "slice", "gather", "scatter", "sum", "mean", "amax", "any", "argmax",
)  # fmt: skip
"""Operations that have the same name and the same arguments."""

TRANSLATIONS: Mapping[str, Translation] = {
    **{name: (name, _same) for name in SAME},
    "expand": ("broadcast", _shaped),
    "view": ("reshape", _shaped),
    "alias": ("reshape", _shaped),
    "_to_copy": ("astype", _cast),
    "split_with_sizes": ("split", _same),
    "getitem": ("item", _same),
    "_softmax": ("softmax", lambda arguments, node: arguments[:2]),
    "_log_softmax": ("log_softmax", lambda arguments, node: arguments[:2]),
    "native_layer_norm": ("layer_norm", _normed),
}
"""By the name of an operation of torch."""


class _Program:
    """A step as operations on arrays, for one robot at a time.

    Attributes:
        calls: name of the result, operation and arguments, in order; names begin with %.
        outputs: names of action and next memory.
        constants: arrays that calls name.
    """

    def __init__(self, step: RobotStep) -> None:
        self.calls: list[tuple[str, str, list[Any]]] = []
        self._known: dict[Node, Any] = {}
        self._used: dict[str, Tensor] = {}
        with quiet(), torch.no_grad():
            program = torch.export.export(step.eval(), (), step.inputs(1)).run_decompositions()
            lifted = program.graph_signature.inputs_to_lifted_tensor_constants
            for node in program.graph.nodes:
                if node.op == "placeholder" and node.name in lifted:
                    self._known[node] = program.constants[lifted[node.name]]
                elif node.op == "call_function" and not str(node.target).startswith(
                    tuple(f"aten.{name}." for name in CHECKS)
                ):
                    self._add(node)
                elif node.op == "output":
                    self.outputs = [self._named(each) for each in node.args[0]]
        self.constants = self._used

    def _add(self, node: Node) -> None:
        """Computes a node if it is the same for all inputs, else adds its call."""
        overload: Any = node.target
        name = overload.__name__.partition(".")[0]  # such as `add` of `aten.add.Tensor`
        if name == "full_like":
            like, fill = node.meta["val"], node.args[1]
            assert isinstance(fill, int | float)
            self._known[node] = torch.full(like.shape, fill, dtype=like.dtype)
        elif all(each in self._known for each in node.all_input_nodes):
            given = torch.fx.map_arg((node.args, node.kwargs), self._known.__getitem__)
            self._known[node] = node.target(*given[0], **given[1])  # type: ignore[operator]
        elif name in TRANSLATIONS:
            operation, arrange = TRANSLATIONS[name]
            arguments = arrange([self._named(each) for each in node.args], node)
            self.calls.append((f"%{node.name}", operation, list(arguments)))
        else:
            raise PolicyFitError(
                f"this policy computes {node.target}, which files of Python and NumPy do not have. "
                "Export it as ONNX (policy.onnx)."
            )

    def _named(self, given: Any) -> Any:
        """An argument with names in the place of arrays."""
        if isinstance(given, Node):
            name = f"%{given.name}"
            if given in self._known:
                self._used[name] = self._known[given]
            return name
        if isinstance(given, list | tuple):
            return [self._named(each) for each in given]
        return given
