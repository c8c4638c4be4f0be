"""Names on a command line to the policies they mean, and the evaluation of several of them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec as find_module
from pathlib import Path

from swarmdata.behavior_policies.tiers import (
    TIERS,
    TRAINED_TIERS,
    find_recipe,
    is_dataset,
    shipped_recipes,
    sources,
)
from swarmdata.cards.references import summarize
from swarmdata.errors import MissingExtraError, ResultsError, SpecError, UnknownNameError
from swarmdata.evaluation.results.result_files import Result, load_result, located, save_result
from swarmdata.evaluation.runs.provenance import Provenance, file_name
from swarmdata.evaluation.runs.run_files import run_folders
from swarmdata.hub.remotes.outside_names import is_folder
from swarmdata.interfaces import Policy
from swarmdata.numerics.random import evaluation_seeds
from swarmdata.perception.observer import features_of
from swarmdata.registry.components import POLICIES, make_policy, make_task
from swarmdata.registry.presets import find_spec
from swarmdata.registry.published import TaskReferences
from swarmdata.rollouts.evaluate import evaluate
from swarmdata.rollouts.recipe_episodes import make_source_policy
from swarmdata.specs.model_choice import Source, check_senses, with_models
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import EvalResult

REFERENCES = ("idle", "random", "straight", "scripted", "medium", "expert")
"""Policies that a task's reference table holds, as far as the task has them."""


@dataclass(frozen=True, eq=False)
class Target:
    """A named team: one policy, or one per training seed or checkpoint."""

    spec: TaskSpec
    policies: tuple[Policy, ...]
    provenances: tuple[Provenance, ...]  # of each policy; all with one label

    @property
    def label(self) -> str:
        """Its row in tables."""
        return self.provenances[0].label

    def labelled(self, label: str) -> "Target":
        """The same team under another name.

        Raises:
            SpecError: it cannot be part of a file's name.
        """
        named = (each.model_dump() | {"label": label} for each in self.provenances)
        parsed = tuple(Provenance.parse(each, f"label {label!r}") for each in named)
        return replace(self, provenances=parsed)


@dataclass(frozen=True)
class Models:
    """Models to evaluate under; None keeps those that a policy's spec has."""

    observation: Source | None = None
    communication: Source | None = None

    def offered_to(self, policy: str, trained: TaskSpec, *, is_fixed: bool) -> TaskSpec:
        """The spec that a policy acts in.

        Args:
            policy: its name, for messages.
            trained: the spec that it was made for.
            is_fixed: whether it reads observations and so needs the features it was trained on.

        Raises:
            SchemaError: it needs other features than there are.
        """
        spec = with_models(trained, self.observation, self.communication)
        if is_fixed and spec != trained:
            features = (features_of(make_task(each)) for each in (trained, spec))
            check_senses(policy, trained, spec, *features)
        return spec


def find_target(
    name: str,
    task: str = "coop_nav",
    observation: Source | None = None,
    communication: Source | None = None,
) -> Target:
    """Returns what a name means.

    Args:
        name: a registered policy such as `random`; a learned tier such as `expert`, which means
            its checkpoints without noise; a dataset's id, which means its behavior policies as
            recorded; or a run folder, which means its newest policies, one per seed.
        task: of a policy or tier: a preset's name, or a spec's file.
        observation: what the robots sense, such as `lidar`; None: what the task, the dataset or
            the training had.
        communication: what they hear, such as `lossy-30`; the same.

    Raises:
        UnknownNameError: nothing has that name.
        SchemaError: a trained policy does not have the inputs that these models give.
        SpecError: a run folder of a recording of another environment.
        MissingExtraError: a run folder without torch.
    """
    models = Models(observation, communication)
    if is_folder(name) and run_folders(Path(name)):
        return _run_target(Path(name), models)
    if name in POLICIES and name != "learned":
        spec = models.offered_to(name, find_spec(task), is_fixed=False)
        return Target(spec, (make_policy(name, spec),), (Provenance(label=name),))
    if name in TRAINED_TIERS and (found := sources(task, name, 0.0)):
        spec = models.offered_to(name, find_spec(task), is_fixed=True)
        policies = tuple(make_source_policy(source, spec) for source in found)
        contents = [source.sha256 for source in found]
        return Target(spec, policies, _numbered(name, contents))
    return _dataset_target(name, task, models)


def _numbered(label: str, contents: Sequence[str | None]) -> tuple[Provenance, ...]:
    return tuple(
        Provenance(label=label, index=index, content=content)
        for index, content in enumerate(contents)
    )


def _dataset_target(name: str, task: str, models: Models) -> Target:
    if not is_dataset(name):
        trained = {tier for tier in TRAINED_TIERS if sources(task, tier)}
        known = {*POLICIES, *trained, *shipped_recipes()} - {"learned"}
        raise UnknownNameError("policy, tier, dataset or run folder", name, known)
    recipe = find_recipe(name)
    is_fixed = any(source.name == "learned" for source in recipe.policies)
    spec = models.offered_to(name, recipe.spec, is_fixed=is_fixed)
    policies = tuple(make_source_policy(source, spec) for source in recipe.policies)
    return Target(spec, policies, _numbered(name, [recipe.hash()] * len(policies)))


def _run_target(folder: Path, models: Models) -> Target:
    require("torch", "torch", f"loading the run {folder}")
    from swarmdata.evaluation.runs.trained_policies import load_policies, read_trained  # noqa: PLC0415  (torch is an extra)

    trained = read_trained(folder)
    if trained.spec.get("kind") == "recorded":
        raise SpecError(
            f"{folder} was trained on a recording of {trained.spec['task']}, which this library "
            "cannot run. Evaluate it with swarmdata.record.evaluate_parallel and the environment."
        )
    spec = TaskSpec.parse(trained.spec, str(folder))
    spec = models.offered_to(str(folder), spec, is_fixed=True)
    return Target(spec, tuple(load_policies(trained)), trained.provenances)


def require(package: str, extra: str, purpose: str) -> None:
    """Raises MissingExtraError unless the package is installed; imports nothing."""
    if find_module(package) is None:
        raise MissingExtraError(package, extra, purpose)


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
