"""An entry: a folder with the policies of some training seeds, their results and a description.

    entry.json          dataset and its digest, algorithm, tuning, license, hashes of the policies
    policy-0.safetensors, policy-1.safetensors, ...; or policy-0.onnx, ... of other libraries
    results/            one file for each policy, as `swarmdata evaluate --out` writes them

Nothing in it can be executed.
"""

import hashlib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

from pydantic import Field

from swarmdata.errors import SpecError
from swarmdata.evaluation.results.policy_names import ONNX_SUFFIX, Target, find_target, onnx_target
from swarmdata.evaluation.results.target_evaluation import evaluate_target
from swarmdata.evaluation.runs.provenance import FilePart, Natural
from swarmdata.interfaces import Policy
from swarmdata.learn.deployment.onnx_policy import OnnxPolicy
from swarmdata.learn.policies.policy_file import load_policy, save_policy
from swarmdata.registry.published import published
from swarmdata.registry.recipes import find_recipe
from swarmdata.runtime.atomic import write_file
from swarmdata.runtime.output_folder import check_marked
from swarmdata.specs.frozen import Frozen
from swarmdata.specs.origins import task_of
from swarmdata.specs.plain_names import Sha256
from swarmdata.specs.recipe import Recipe
from swarmdata.specs.task_spec import TaskSpec

ENTRY, RESULTS = "entry.json", "results"

N_EPISODES = 1000  # reserved episodes that an entry is evaluated on

LEAST_SEEDS = 5

LARGEST = 25_000_000  # bytes of an entry


class Description(Frozen):
    """What an entry says of itself."""

    format: Literal["swarmdata-entry"] = "swarmdata-entry"
    format_version: Literal[1] = 1
    name: FilePart  # of its row
    dataset: FilePart  # id with version, that the policies were trained on
    digest: Sha256  # of that dataset
    algorithm: str
    license: str = Field(min_length=1)  # of the policies
    code: str = Field(min_length=1)  # where the training's code is
    trials: Natural  # configurations that were tried, this one included
    tuning_episodes: Natural  # simulated episodes that settings were chosen on; 0: none
    policies: tuple[Sha256, ...]  # of policy-0, policy-1, ...
    is_onnx: bool = False  # whether the policies are files of ONNX, of another library

    @property
    def files(self) -> tuple[str, ...]:
        """Names of the policies' files."""
        return tuple(policy_name(i, is_onnx=self.is_onnx) for i in range(len(self.policies)))


def policy_name(index: int, *, is_onnx: bool = False) -> str:
    """Returns the name of the file of a policy."""
    return f"policy-{index}{ONNX_SUFFIX if is_onnx else '.safetensors'}"


def submit(
    runs: Sequence[Path],
    out: Path,
    dataset: str,
    *,
    name: str,
    license: str,
    code: str,
    trials: int,
    tuning_episodes: int,
    n_episodes: int = N_EPISODES,
    progress: bool = True,
) -> Description:
    """Makes an entry of trained runs of one algorithm on a published dataset.

    `runs` are their folders, or files of ONNX, a policy each; the folder `out` is new or empty, or
    of an earlier entry. What the entry says of itself is as in `Description`.

    Raises:
        SpecError: a run was trained on other data or in other conditions, or there are fewer than
            `LEAST_SEEDS` policies.
        UnknownNameError: no such published dataset.
        OutputError: the folder has other files.
    """
    check_marked(out, ENTRY, "leaderboard entry")
    recipe = find_recipe(dataset)
    digest = published()[recipe.id].digest
    is_onnx = all(run.suffix == ONNX_SUFFIX for run in runs)
    team = (_team_of_files if is_onnx else _team)(runs, recipe, digest)
    files = [out / policy_name(i, is_onnx=is_onnx) for i in range(len(team.policies))]
    for index, file in enumerate(files):
        if is_onnx:
            write_file(file, runs[index].read_bytes())
        else:
            save_policy(file, team.policies[index])
    hashes = tuple(map(sha256, files))
    description = Description(
        name=name, dataset=recipe.id, digest=digest,
        algorithm=team.provenances[0].algorithm or name, license=license, code=code, trials=trials,
        tuning_episodes=tuning_episodes, policies=hashes, is_onnx=is_onnx,
    )  # fmt: skip
    said = {"label": name, "algorithm": description.algorithm, "run": None}
    provenances = tuple(
        each.model_copy(update={**said, "index": index, "content": content})
        for index, (each, content) in enumerate(zip(team.provenances, hashes, strict=True))
    )
    named = replace(team, provenances=provenances)
    evaluate_target(named, n_episodes, out / RESULTS, again=True, progress=progress)
    write_file(out / ENTRY, description.model_dump_json(indent=1).encode() + b"\n")
    return description


def _team(runs: Sequence[Path], recipe: Recipe, digest: str) -> Target:
    """The policies of all runs; refuses runs on other data, or for other rewards."""
    targets = [find_target(str(run)) for run in runs]
    for run, target in zip(runs, targets, strict=True):
        for each in target.provenances:
            if (each.dataset, each.digest, each.view) != (recipe.id, digest, None):
                view = "" if each.view is None else f" seen as {each.view}"
                raise SpecError(
                    f"{run} was trained on {each.dataset} with digest {str(each.digest)[:12]}"
                    f"{view}, expected {recipe.id} as published, {digest[:12]}"
                )
    policies = tuple(policy for target in targets for policy in target.policies)
    _check_number(policies)
    provenances = tuple(each for target in targets for each in target.provenances)
    return Target(targets[0].spec, policies, provenances)


def _team_of_files(files: Sequence[Path], recipe: Recipe, digest: str) -> Target:
    """The policies in files of ONNX, which are said to be trained on the dataset."""
    _check_number(files)
    team = onnx_target(files, task_of(recipe, "a leaderboard"), "onnx")
    said = {"dataset": recipe.id, "digest": digest}
    provenances = tuple(each.model_copy(update=said) for each in team.provenances)
    return replace(team, provenances=provenances)


def _check_number(policies: Sequence[object]) -> None:
    if len(policies) < LEAST_SEEDS:
        raise SpecError(
            f"there are {len(policies)} policies, expected at least {LEAST_SEEDS} training seeds; "
            "train with --seeds 5"
        )


def read_policy(file: Path, spec: TaskSpec) -> Policy:
    """Reads a policy of an entry."""
    return OnnxPolicy(file, spec) if file.suffix == ONNX_SUFFIX else load_policy(file)


def sha256(path: Path) -> str:
    """Returns the SHA-256 of a file, in hexadecimal digits."""
    return hashlib.sha256(path.read_bytes()).hexdigest()
