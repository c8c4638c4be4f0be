"""Evaluates named teams on the reserved seeds, and measures the reference policies of a task."""

from collections.abc import Sequence
from pathlib import Path

from swarmdata.behavior_policies.tiers import TIERS, sources
from swarmdata.cards.references import summarize
from swarmdata.errors import ResultsError
from swarmdata.evaluation.results.policy_names import Target, find_target
from swarmdata.evaluation.results.result_files import Result, load_result, located, save_result
from swarmdata.evaluation.runs.provenance import Provenance, file_name
from swarmdata.numerics.random import evaluation_seeds
from swarmdata.registry.presets import find_spec
from swarmdata.registry.published import TaskReferences
from swarmdata.rollouts.evaluate import evaluate
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import EvalResult

REFERENCES = ("idle", "random", "straight", "scripted", "medium", "expert")
"""Policies that a task's reference table holds, as far as the task has them."""


def evaluate_target(
    target: Target,
    n_episodes: int,
    out: Path | None = None,
    *,
    again: bool = False,
    progress: bool = True,
) -> list[Result]:
    """Evaluates every policy of a target on the reserved seeds.

    Args:
        target: the team.
        n_episodes: first so many reserved seeds.
        out: a folder that gets one file per policy (`provenance.file_name`). What is there already
            of the same policy, spec, seeds and code is read instead of measured.
        again: measures it all the same.
        progress: whether to show bars.

    Returns:
        One result per policy; those that were read have a path.

    Raises:
        ResultsError: a file of `out` is of another run with the same label and dataset.
    """
    results = []
    for policy, provenance in zip(target.policies, target.provenances, strict=True):
        kept = None if out is None else kept_result(target.spec, provenance, n_episodes, out)
        if kept is None or again:
            evaluation = evaluate(
                policy, target.spec, name=target.label, n_episodes=n_episodes, progress=progress
            )
            kept = Result(evaluation, provenance, target.spec)
            if out is not None:
                save_result(kept, out)
        results.append(kept)
    return results


def kept_result(
    spec: TaskSpec, provenance: Provenance, n_episodes: int, out: Path
) -> Result | None:
    """The result that a folder has of exactly this policy, spec, seeds and code, if it has it.

    Raises:
        ResultsError: the file in its place is of another run.
    """
    path = out / file_name(provenance, spec.hash())
    if not path.exists():
        return None
    wanted, found = located(provenance, out), load_result(path)
    if found.provenance.run != wanted.run:
        raise ResultsError(
            f"{path} is of the run {found.provenance.run}, not of {wanted.run}: two runs have the "
            f"label {wanted.label!r} on the same dataset. Give one another label (--label), or "
            "choose another folder."
        )
    measured = found.evaluation
    is_same = (  # a file's name has only the first digits of the spec's hash
        found.provenance == wanted
        and measured.spec_hash == spec.hash()
        and measured.seeds.tolist() == evaluation_seeds(n_episodes).tolist()
    )
    return found if is_same else None


def measure_references(
    task: str, n_episodes: int, names: Sequence[str] = REFERENCES, *, progress: bool = True
) -> TaskReferences:
    """Evaluates the reference policies of a task; tiers without checkpoints are left out.

    Args:
        task: a preset's name, or a spec's file.
        n_episodes: first so many reserved seeds.
        names: of the policies and tiers.
        progress: whether to show bars.

    Raises:
        UnknownNameError: no such task.
        SpecError: the file is not a spec.
    """
    find_spec(task)
    there = [name for name in names if name not in TIERS or sources(task, name)]
    results: dict[str, list[EvalResult]] = {}
    for target in (find_target(name, task) for name in there):
        measured = evaluate_target(target, n_episodes, progress=progress)
        found = [each.evaluation for each in measured]
        results[target.label] = found
        if len(found) > 1:  # the tier is their mean; each is shown as well
            results |= {f"{target.label}-{index}": [each] for index, each in enumerate(found)}
    return summarize(results)
