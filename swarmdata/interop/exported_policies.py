"""Exports a trained policy by the name of its run, with what a robot has to know about it."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, get_args

from swarmdata.errors import PolicyFitError, SpecError
from swarmdata.evaluation.results.policy_names import find_target
from swarmdata.evaluation.runs.named_policies import index_of, open_run
from swarmdata.evaluation.runs.portable_names import without_places
from swarmdata.evaluation.runs.provenance import Provenance
from swarmdata.interfaces import Policy
from swarmdata.learn.training.run_files import find_run
from swarmdata.perception.observer import features_of
from swarmdata.registry.components import make_task
from swarmdata.runtime.extras import require_extra
from swarmdata.specs.action_scaling import action_scale
from swarmdata.specs.origins import RecordedSpec, SideSpec
from swarmdata.specs.origins.log_map import Motion
from swarmdata.specs.spaces import column_names, width
from swarmdata.specs.task_spec import TaskSpec

SUFFIXES = (".onnx", ".py")  # of files that a policy can become

Trainable = TaskSpec | SideSpec | RecordedSpec


def export_policy(name: Path | str, path: Path | str, seed: int | None = None) -> Path:
    """Writes the policy of one training seed for robots: as ONNX, or as Python with NumPy alone.

    The file has the frame, the normalization, the network and its memory, the names of robots and
    features, the commands that actions mean, and the provenance of the policy.

    Args:
        name: folder of a run.
        path: of the file, which must not exist: its suffix is `.onnx`, or `.py` for NumPy.
        seed: of the training; None: the first.

    Raises:
        SpecError: the run has no such seed, or the file another suffix.
        PolicyFitError: policies of this kind cannot be exported, or choose among whole numbers.
        ConversionError: `path` exists.
        MissingExtraError: torch, or for ONNX the extra `onnx`, is not installed.
    """
    path = Path(path)
    if path.suffix not in SUFFIXES:
        raise SpecError(
            f"{path} has the suffix {path.suffix!r}, expected .onnx, or .py for a file of Python "
            "that needs NumPy alone"
        )
    require_extra("torch", "torch", "reading a policy")
    from swarmdata.learn.deployment.numpy_file import export_numpy  # noqa: PLC0415  (torch)
    from swarmdata.learn.deployment.onnx_file import export_onnx  # noqa: PLC0415  (torch)

    spec, policies, provenances = _trained(str(name))
    k = index_of(seed, provenances, name)
    if isinstance(spec, RecordedSpec):
        features = [column_names(agent.observation) for agent in spec.agents]
    else:
        task = spec.whole if isinstance(spec, SideSpec) else spec
        features = [[each.name for each in features_of(make_task(task))]] * spec.n_agents
    export = export_onnx if path.suffix == ".onnx" else export_numpy
    return export(
        policies[k],
        path,
        robots=spec.agent_names,
        features=features,
        about={
            "provenance": without_places(provenances[k].model_dump(mode="json")),
            "spec": spec.model_dump(mode="json"),
            **_commands(spec),
        },
    )


def _trained(name: str) -> tuple[Trainable, Sequence[Policy], Sequence[Provenance]]:
    """Spec, policies and provenances of a run, on a task, a side of it, or a recording."""
    if (run := find_run(name)) is not None:
        found = open_run(run)
        if found.side is not None:
            return found.side, found.policies(), found.provenances
        if found.spec.get("kind") == "recorded":
            return RecordedSpec.parse(found.spec, name), found.policies(), found.provenances
    target = find_target(name)
    return target.spec, target.policies, target.provenances


def _commands(spec: Trainable) -> dict[str, Any]:
    """What actions mean: middle + half * action, in SI units; `stop` is None where not known."""
    if not isinstance(spec, RecordedSpec):
        commands = []
        for robot in spec.robots:
            is_speed = robot.command == "velocity"
            most = robot.max_speed if is_speed else robot.acceleration
            half = [most, robot.max_turn_rate if robot.dynamics == "unicycle" else most]
            stop = [0.0, 0.0] if is_speed else None
            commands.append(
                {"middle": [0.0, 0.0], "half": half, "norm": robot.command_norm, "stop": stop}
            )
        return {"time_step": spec.time_step, "commands": commands}
    if spec.action_kind == "choices":
        raise PolicyFitError(
            f"policies for {spec.task} choose among whole numbers, expected continuous commands"
        )
    named = spec.options.get("commands", {})
    scale, found = action_scale(spec), []
    for agent, middle, half in zip(spec.agents, scale.middle, scale.half, strict=True):
        n = width(agent.action)
        is_motion = all(name in get_args(Motion) for name in named.get(agent.name, [""]))
        found.append(
            {"middle": middle[:n].tolist(), "half": half[:n].tolist(), "norm": None,
             "stop": [0.0] * n if is_motion else None}
        )  # fmt: skip
    return {"time_step": spec.time_step, "commands": found}
