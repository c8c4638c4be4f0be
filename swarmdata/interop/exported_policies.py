"""Exports a trained policy by the name of its run, with what a robot has to know about it."""

from pathlib import Path

from swarmdata.errors import SpecError
from swarmdata.evaluation.results.policy_names import find_target
from swarmdata.evaluation.runs.portable_names import without_places
from swarmdata.perception.observer import features_of
from swarmdata.registry.components import make_task
from swarmdata.runtime.extras import require_extra


def export_policy(name: Path | str, path: Path | str, seed: int = 0) -> Path:
    """Writes the policy of one training seed as a file of ONNX (`learn.deployment`).

    The file's metadata have the names of robots and features, the spec of the task and the
    provenance of the policy.

    Args:
        name: folder of a run.
        path: of the file; it must not exist.
        seed: of the training.

    Raises:
        SpecError: the run has no such seed.
        PolicyFitError: policies of this kind cannot be exported.
        ConversionError: `path` exists.
        MissingExtraError: torch or the extra `onnx` is not installed.
    """
    require_extra("torch", "torch", "reading a policy")
    from swarmdata.learn.deployment.onnx_file import export_onnx  # noqa: PLC0415  (torch)

    target = find_target(str(name))
    seeds = [each.seed for each in target.provenances]
    if seed not in seeds:
        raise SpecError(f"{name} has the seeds {', '.join(map(str, seeds))}, got seed {seed}")
    k = seeds.index(seed)
    return export_onnx(
        target.policies[k],
        Path(path),
        robots=target.spec.agent_names,
        features=[feature.name for feature in features_of(make_task(target.spec))],
        about={
            "provenance": without_places(target.provenances[k].model_dump(mode="json")),
            "spec": target.spec.model_dump(mode="json"),
        },
    )
