"""Evaluates named teams, and measures the reference policies of a task."""

from collections.abc import Callable, Sequence
from pathlib import Path

from swarmdata.cards.references import LESS_COORDINATED, summarize
from swarmdata.errors import ResultsError
from swarmdata.evaluation.results.policy_names import Target, find_target
from swarmdata.evaluation.results.result_files import (
    Result,
    load_result,
    save_result,
    with_relative_run,
)
from swarmdata.evaluation.runs.provenance import Provenance, file_name
from swarmdata.numerics.random import SeedBlock, block_seeds
from swarmdata.registry.presets import find_spec
from swarmdata.registry.published import REFERENCE_OPPONENTS, TaskReferences
from swarmdata.registry.recipes import sources
from swarmdata.registry.tiers import TIERS
from swarmdata.rollouts.evaluate import evaluate
from swarmdata.specs.model_choice import with_models
from swarmdata.specs.origins import Spec
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import EvalResult, Seeds

REFERENCE_POLICIES = (
    "idle", "random", "straight", "scripted", *LESS_COORDINATED, "medium", "expert"
)  # fmt: skip
"""Policies in the reference table of a task, if the task has them, beside its naive teams."""


def evaluate_target(
    target: Target,
    n_episodes: int,
    out: Path | None = None,
    *,
    block: SeedBlock = "evaluation",
    again: bool = False,
    n_threads: int = 1,
    progress: bool = True,
    report: Callable[[int], object] = lambda episodes: None,
) -> list[Result]:
    """Evaluates every policy of a target on the first seeds of a block, as `evaluate` does.

    The folder `out` gets a file per policy (`provenance.file_name`). Results in it of the same
    policy, spec, seeds and code are reused, and have a path, unless `again`. `report` is called
    with the number of episodes that have just finished. Raises ResultsError if a file in `out` is
    of another run with the same label and dataset.
    """
    results, seeds = [], block_seeds(block, n_episodes)
    for policy, provenance in zip(target.policies, target.provenances, strict=True):
        kept = None if out is None else kept_result(target.measured, provenance, seeds, out)
        if kept is None or again:
            evaluation = evaluate(
                policy, target.spec, name=target.label, n_episodes=n_episodes, block=block,
                side=target.side, n_threads=n_threads, progress=progress, report=report,
            )  # fmt: skip
            kept = Result(evaluation, provenance, target.measured)
            if out is not None:
                save_result(kept, out, replace=True)
        results.append(kept)
    return results


def kept_result(spec: Spec, provenance: Provenance, seeds: Seeds, out: Path) -> Result | None:
    """Reads the result of exactly this policy, spec, seeds and code, if a folder has it."""
    path = out / file_name(provenance, spec.hash())
    if not path.exists():
        return None
    wanted, found = with_relative_run(provenance, out), load_result(path)
    if found.provenance.run != wanted.run:
        raise ResultsError(
            f"{path} is of the run {found.provenance.run}, not of {wanted.run}: two runs have the "
            f"label {wanted.label!r} on the same dataset. Pass another --label or another folder."
        )
    measured = found.evaluation
    is_same = (  # the file's name has only the first digits of the spec's hash
        found.provenance == wanted
        and measured.spec_hash == spec.hash()
        and measured.seeds.tolist() == seeds.tolist()
    )
    return found if is_same else None


def reference_teams(task: str, spec: TaskSpec, side: str | None = None) -> list[str]:
    """`REFERENCE_POLICIES` and naive teams that a preset or a file has: tiers need checkpoints.

    Those that leave out coordination, and naive teams, are of the first side.
    """
    if side not in (None, spec.sides[0].name):
        names = [name for name in REFERENCE_POLICIES if name not in LESS_COORDINATED]
        return [name for name in names if name not in TIERS or sources(task, name)]
    is_silent = spec.communication.kind == "none"
    return [
        name
        for name in (*REFERENCE_POLICIES, *spec.rules.naive_teams)
        if (name not in TIERS or sources(task, name))
        and not (name == "scripted-deaf" and is_silent)
    ]


def measure_references(
    task: str,
    n_episodes: int,
    names: Sequence[str] | None = None,
    *,
    side: str | None = None,
    backend: str | None = None,
    progress: bool = True,
) -> TaskReferences:
    """Evaluates a task's reference policies, a preset's name or a spec file, on reserved seeds.

    They are the `reference_teams`, in the task's simulator, unless names or a simulator are given;
    of a side, against the scripted others.
    """
    spec = find_spec(task)
    available = reference_teams(task, spec, side) if names is None else names
    opponents = None if side is None else REFERENCE_OPPONENTS
    results: dict[str, list[EvalResult]] = {}
    for name in available:
        target = find_target(name, task, backend=backend, side=side, opponents=opponents)
        measured = evaluate_target(target, n_episodes, progress=progress)
        found = [each.evaluation for each in measured]
        results[target.label] = found
        if len(found) > 1:  # besides the mean of the tier, list each policy
            results |= {f"{target.label}-{index}": [each] for index, each in enumerate(found)}
    naive_teams = tuple(spec.rules.naive_teams)
    return summarize(results, with_models(spec, backend=backend).backend, naive_teams)


def reference_tables(
    task: str, n_episodes: int, backend: str | None = None
) -> dict[str, TaskReferences]:
    """Measures the references of a task of one side, or those of each of its sides, by name."""
    name = Path(task).stem if backend is None else f"{Path(task).stem}-{backend}"
    sides = [side.name for side in find_spec(task).sides]
    if len(sides) == 1:
        return {name: measure_references(task, n_episodes, backend=backend)}
    return {
        f"{name}-{side}": measure_references(task, n_episodes, side=side, backend=backend)
        for side in sides
    }
