"""A policy of one seed as a file of ONNX, which a robot runs without this package or torch."""

import contextlib
import json
import logging
import warnings
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import torch

from swarmdata.interfaces import Policy
from swarmdata.learn.deployment.robot_step import RobotStep, description, fitting_step
from swarmdata.runtime.atomic import staged
from swarmdata.runtime.extras import require_extra

METADATA_KEY = "swarmdata"
"""Of the entry in the file's metadata, JSON."""


def export_onnx(
    policy: Policy,
    path: Path,
    *,
    robots: Sequence[str],
    features: Sequence[Sequence[str]],
    about: Mapping[str, Any],
) -> Path:
    """Writes a policy of one seed as a network of one robot.

    Inputs are `observation`, float32 [B, O], in the world's frame and in its own units, and
    `robot`, int64 [B], the robot's number in the team; a policy with a memory has `memory`,
    float32 [B, M], too, zeros when an episode begins. Outputs are `action`, float32 [B, A], as
    worlds take it, and `next_memory`. B is free.

    Args:
        policy: as a run has it.
        path: of the file; it must not exist.
        robots: names of the robots, [N].
        features: names of the numbers that each robot observes, [N] with at most O each.
        about: further facts for the file's metadata.

    Raises:
        PolicyFitError: policies of this kind cannot be exported.
        ConversionError: `path` exists, or the observations are not those of the policy.
        MissingExtraError: the extra `onnx` is not installed.
    """
    for package in ("onnx", "onnxscript"):
        require_extra(package, "onnx", "exporting a policy")
    step = fitting_step(policy, path, features)
    model = _traced(step)
    known = description(step, robots, features, about)
    entry = model.metadata_props.add()
    entry.key, entry.value = METADATA_KEY, json.dumps(known)
    with staged(path) as target:
        target.write_bytes(model.SerializeToString())
    return path


def _traced(step: RobotStep) -> Any:
    """The step as a model of ONNX, for any number of rows."""
    inputs = step.inputs(2)  # rows; any number above 1, which tracing would take for a constant
    outputs = ["action", "next_memory"] if step.memory else ["action"]
    batch = torch.export.Dim("rows", min=1)
    with quiet(), torch.no_grad():
        program = torch.onnx.export(
            step.eval(), (), kwargs=inputs, dynamo=True, verbose=False,
            input_names=list(inputs), output_names=outputs,
            dynamic_shapes={name: {0: batch} for name in inputs},
        )  # fmt: skip
    assert program is not None
    model = program.model_proto
    for node in model.graph.node:  # torch's: the lines of code behind each, with their paths
        node.ClearField("metadata_props")
    return model


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """Hides what torch says about its own exporter."""
    log = logging.getLogger("torch.onnx")
    level = log.level
    log.setLevel(logging.ERROR)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        log.setLevel(level)
