"""Names on a command line to the policies they mean, and the evaluation of several of them."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from swarmdata.behavior_policies.learned import own_actor
from swarmdata.behavior_policies.tiers import (
    MIXTURES,
    SPECS,
    find_recipe,
    is_dataset,
    shipped_recipes,
    sources,
)
from swarmdata.cards.references import summarize
from swarmdata.cards.schema import TaskReferences
from swarmdata.errors import CheckpointError, MissingExtraError, UnknownNameError
from swarmdata.evaluate import evaluate, save
from swarmdata.interfaces import Policy
from swarmdata.recipes import make_source_policy
from swarmdata.registry import ONLINE_ALGORITHMS, POLICIES, make_policy
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


def find_target(name: str, task: str = "coop_nav") -> Target:
    """Returns what a name means.

    Args:
        name: a registered policy such as `random`; a learned tier such as `expert`, which means
            its checkpoints without noise; a dataset's id, which means its behavior policies as
            recorded; or a run folder, which means its policies, one per seed (the last actor of an
            online run).
        task: of a policy or tier.

    Raises:
        UnknownNameError: nothing has that name.
        MissingExtraError: a run folder without torch.
    """
    if (Path(name) / RUN_FILE).exists():
        return _run_target(Path(name))
    spec = task_spec(task)
    if name in POLICIES and name != "learned":
        return Target(name, spec, (make_policy(name, spec),), {"policy": name})
    if name in MIXTURES and MIXTURES[name][0] == (name,) and (found := sources(task, name, 0.0)):
        policies = tuple(make_source_policy(source, spec) for source in found)
        digests = [source.sha256 for source in found]
        return Target(name, spec, policies, {"policy": name, "checkpoints": digests})
    return _dataset_target(name, task)


def task_spec(task: str) -> TaskSpec:
    """The headline spec of a task.

    Raises:
        UnknownNameError: no such task.
    """
    if task not in SPECS:
        raise UnknownNameError("task", task, SPECS)
    return SPECS[task]


def _dataset_target(name: str, task: str) -> Target:
    if not is_dataset(name):
        tiers = {tier for tier, (parts, _) in MIXTURES.items() if parts == (tier,)}
        trained = {tier for tier in tiers if sources(task, tier)}
        known = {*POLICIES, *trained, *shipped_recipes()} - {"learned"}
        raise UnknownNameError("policy, tier, dataset or run folder", name, known)
    recipe = find_recipe(name)
    policies = tuple(make_source_policy(source, recipe.spec) for source in recipe.policies)
    return Target(name, recipe.spec, policies, {"recipe": recipe.hash()})


def _online_target(folder: Path, document: dict[str, Any]) -> Target:
    """The last actor of an online run, so far."""
    spec = TaskSpec.parse(document["spec"], str(folder / RUN_FILE))
    actors = sorted((folder / "actors").glob("*.safetensors"))
    if not actors:
        raise CheckpointError(f"{folder} has no actors yet; wait for the run's first checkpoint")
    metadata = {"run": {**document, "frames": int(actors[-1].stem)}}
    return Target(folder.resolve().name, spec, (own_actor(actors[-1], spec),), metadata)


def _run_target(folder: Path) -> Target:
    document = json.loads((folder / RUN_FILE).read_text(encoding="utf-8"))
    if document.get("algorithm") in ONLINE_ALGORITHMS:
        return _online_target(folder, document)
    require("torch", "torch", f"loading the run {folder}")
    from swarmdata.learn.run import load_run, read_run  # noqa: PLC0415  (torch is an extra)

    run = read_run(folder)
    metadata = {"run": run.model_dump(mode="json", exclude={"spec"})}
    return Target(folder.resolve().name, run.spec, tuple(load_run(folder)), metadata)


def require(package: str, extra: str, purpose: str) -> None:
    """Raises MissingExtraError unless the package is installed; imports nothing."""
    if find_spec(package) is None:
        raise MissingExtraError(package, extra, purpose)


def evaluate_target(
    target: Target, n_episodes: int, out: Path | None = None, *, progress: bool = True
) -> list[EvalResult]:
    """Evaluates every policy of a target on the reserved seeds.

    Args:
        target: the team.
        n_episodes: first so many reserved seeds.
        out: a folder that gets one file per policy, `<label>-<index>.json`.
        progress: whether to show bars.
    """
    results = []
    for index, policy in enumerate(target.policies):
        result = evaluate(
            policy, target.spec, name=target.label, n_episodes=n_episodes, progress=progress
        )
        if out is not None:
            out.mkdir(parents=True, exist_ok=True)
            metadata = {**target.metadata, "index": index}
            save(result, out / f"{target.label}-{index}.json", metadata=metadata)
        results.append(result)
    return results


def measure_references(
    task: str, n_episodes: int, names: Sequence[str] = REFERENCES, *, progress: bool = True
) -> TaskReferences:
    """Evaluates the reference policies of a task; tiers without checkpoints are left out.

    Raises:
        UnknownNameError: no such task.
    """
    task_spec(task)
    there = [name for name in names if name not in MIXTURES or sources(task, name)]
    targets = [find_target(name, task) for name in there]
    return summarize({t.label: evaluate_target(t, n_episodes, progress=progress) for t in targets})
