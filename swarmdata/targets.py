"""Names on a command line to the policies they mean, and the evaluation of several of them."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec as find_module
from pathlib import Path
from typing import Any

from swarmdata.behavior_policies.tiers import (
    TIERS,
    TRAINED,
    find_recipe,
    is_dataset,
    shipped_recipes,
    sources,
)
from swarmdata.cards.references import summarize
from swarmdata.cards.schema import TaskReferences
from swarmdata.errors import MissingExtraError, SpecError, UnknownNameError
from swarmdata.evaluate import evaluate, save
from swarmdata.interfaces import Policy
from swarmdata.models import Source, check_senses, models_of, with_models
from swarmdata.observing import features_of
from swarmdata.presets import find_spec
from swarmdata.recipes import make_source_policy
from swarmdata.registry import POLICIES, make_policy, make_task
from swarmdata.spec import TaskSpec
from swarmdata.types import EvalResult

REFERENCES = ("idle", "random", "straight", "scripted", "medium", "expert")
"""Policies that a task's reference table holds, as far as the task has them."""

RUN_FILE = "config.json"
"""What makes a folder a training run."""


@dataclass(frozen=True, eq=False)
class Target:
    """A named team: one policy, or one per training seed or checkpoint."""

    label: str
    spec: TaskSpec
    policies: tuple[Policy, ...]
    metadata: dict[str, Any]  # JSON values: where the policies come from


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
    if run_folders(Path(name)):
        return _run_target(Path(name), models)
    if name in POLICIES and name != "learned":
        spec = models.offered_to(name, find_spec(task), is_fixed=False)
        return Target(name, spec, (make_policy(name, spec),), {"policy": name})
    if name in TRAINED and (found := sources(task, name, 0.0)):
        spec = models.offered_to(name, find_spec(task), is_fixed=True)
        policies = tuple(make_source_policy(source, spec) for source in found)
        digests = [source.sha256 for source in found]
        return Target(name, spec, policies, {"policy": name, "checkpoints": digests})
    return _dataset_target(name, task, models)


def _dataset_target(name: str, task: str, models: Models) -> Target:
    if not is_dataset(name):
        trained = {tier for tier in TRAINED if sources(task, tier)}
        known = {*POLICIES, *trained, *shipped_recipes()} - {"learned"}
        raise UnknownNameError("policy, tier, dataset or run folder", name, known)
    recipe = find_recipe(name)
    is_fixed = any(source.name == "learned" for source in recipe.policies)
    spec = models.offered_to(name, recipe.spec, is_fixed=is_fixed)
    policies = tuple(make_source_policy(source, spec) for source in recipe.policies)
    return Target(name, spec, policies, {"recipe": recipe.hash()})


def run_folders(folder: Path) -> tuple[Path, ...]:
    """The run that a folder is, or those of several processes inside it; empty for another one."""
    inside = sorted(folder.glob(f"seeds-*/{RUN_FILE}"))
    files = [folder / RUN_FILE] if (folder / RUN_FILE).exists() else inside
    return tuple(file.parent for file in files)


def _run_target(folder: Path, models: Models) -> Target:
    require("torch", "torch", f"loading the run {folder}")
    first = run_folders(folder)[0] / RUN_FILE
    document = json.loads(first.read_text(encoding="utf-8"))
    is_offline = "dataset" in document  # vdn and qmix are names of both kinds
    policies, document = _offline_run(folder) if is_offline else _online_run(folder)
    content = document.pop("spec")
    if content.get("kind") == "recorded":
        raise SpecError(
            f"{folder} was trained on a recording of {content['task']}, which this library cannot "
            "run. Evaluate it with swarmdata.record.evaluate_parallel and the environment."
        )
    spec = TaskSpec.parse(content, str(first))
    spec = models.offered_to(str(folder), spec, is_fixed=True)
    return Target(folder.resolve().name, spec, tuple(policies), {"run": document})


def _online_run(folder: Path) -> tuple[list[Policy], dict[str, Any]]:
    """The newest policies of an online run, of all its processes, and what it is."""
    from swarmdata.learn.policy_file import load_policy  # noqa: PLC0415  (torch is an extra)
    from swarmdata.online_algos.run_folder import last_policy_path  # noqa: PLC0415  (the same)
    from swarmdata.online_algos.selection import seeds_of  # noqa: PLC0415  (the same)
    from swarmdata.online_algos.training import read_online_run  # noqa: PLC0415  (the same)

    seeds = seeds_of([folder])
    paths = [last_policy_path(*seed) for seed in seeds]
    document = read_online_run(seeds[0].folder).model_dump(mode="json")
    document |= {"seeds": [seed.seed for seed in seeds], "frames": int(paths[0].stem)}
    return [load_policy(path) for path in paths], document


def _offline_run(folder: Path) -> tuple[list[Policy], dict[str, Any]]:
    """The policies of an offline run, and what it is."""
    from swarmdata.learn.run import load_run, read_run  # noqa: PLC0415  (torch is an extra)

    return load_run(folder), read_run(folder).model_dump(mode="json")


def require(package: str, extra: str, purpose: str) -> None:
    """Raises MissingExtraError unless the package is installed; imports nothing."""
    if find_module(package) is None:
        raise MissingExtraError(package, extra, purpose)


def evaluate_target(
    target: Target, n_episodes: int, out: Path | None = None, *, progress: bool = True
) -> list[EvalResult]:
    """Evaluates every policy of a target on the reserved seeds.

    Args:
        target: the team.
        n_episodes: first so many reserved seeds.
        out: a folder that gets one file per policy, `<label>-<index>.json`; its metadata say where
            the policy comes from and under which models it was measured.
        progress: whether to show bars.
    """
    results = []
    for index, policy in enumerate(target.policies):
        result = evaluate(
            policy, target.spec, name=target.label, n_episodes=n_episodes, progress=progress
        )
        if out is not None:
            out.mkdir(parents=True, exist_ok=True)
            metadata = {
                **target.metadata,
                "models": models_of(target.spec),
                "index": index,
            }
            save(result, out / f"{target.label}-{index}.json", metadata=metadata)
        results.append(result)
    return results


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
        found = evaluate_target(target, n_episodes, progress=progress)
        results[target.label] = found
        if len(found) > 1:  # the tier is their mean; each is shown as well
            results |= {f"{target.label}-{index}": [each] for index, each in enumerate(found)}
    return summarize(results)
