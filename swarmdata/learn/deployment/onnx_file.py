"""A policy of one seed as a file of ONNX, which a robot runs without this package or torch."""

import json
import logging
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import torch

from swarmdata.errors import ConversionError
from swarmdata.interfaces import Policy
from swarmdata.learn.deployment.robot_step import RobotStep, robot_step
from swarmdata.runtime.atomic import staged
from swarmdata.runtime.extras import require_extra

METADATA_KEY = "swarmdata"
"""Of the entry in the file's metadata, JSON."""


def export_onnx(
    policy: Policy,
    path: Path,
    *,
    robots: Sequence[str],
    features: Sequence[str],
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
        features: names of the numbers in an observation, [O].
        about: further facts for the file's metadata.

    Raises:
        PolicyFitError: policies of this kind cannot be exported.
        ConversionError: `path` exists, or the observations are not those of the policy.
        MissingExtraError: the extra `onnx` is not installed.
    """
    for package in ("onnx", "onnxscript"):
        require_extra(package, "onnx", "exporting a policy")
    step = robot_step(policy, len(robots))
    if step.n_features != len(features):
        raise ConversionError(
            f"the policy observes {step.n_features} features, got names of {len(features)}. "
            "Export it for the observation model that it was trained on."
        )
    if path.exists():
        raise ConversionError(f"{path} exists already. Choose another path, or move it away.")
    model = _traced(step)
    known = {**about, "robots": list(robots), "features": list(features), "memory": step.memory}
    entry = model.metadata_props.add()
    entry.key, entry.value = METADATA_KEY, json.dumps(known)
    with staged(path) as target:
        target.write_bytes(model.SerializeToString())
    return path


def _traced(step: RobotStep) -> Any:
    """The step as a model of ONNX, for any number of rows."""
    rows = 2  # any number above 1, which tracing would take for a constant
    inputs = {"observation": torch.zeros(rows, step.n_features), "robot": torch.zeros(rows).long()}
    outputs = ["action"]
    if step.memory:
        inputs["memory"] = torch.zeros(rows, step.memory)
        outputs.append("next_memory")
    batch = torch.export.Dim("rows", min=1)
    log = logging.getLogger("torch.onnx")
    level = log.level
    log.setLevel(logging.ERROR)
    try:
        with warnings.catch_warnings(), torch.no_grad():
            warnings.simplefilter("ignore")  # of torch, about its own exporter
            program = torch.onnx.export(
                step.eval(), (), kwargs=inputs, dynamo=True, verbose=False,
                input_names=list(inputs), output_names=outputs,
                dynamic_shapes={name: {0: batch} for name in inputs},
            )  # fmt: skip
    finally:
        log.setLevel(level)
    assert program is not None
    model = program.model_proto
    for node in model.graph.node:  # torch's: the lines of code behind each, with their paths
        node.ClearField("metadata_props")
    return model
