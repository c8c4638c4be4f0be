"""An entry: a folder with the policies of some training seeds, their results and a description.

    entry.json          dataset and its digest, algorithm, tuning, license, hashes of the policies
    policy-0.safetensors, policy-1.safetensors, ...; or policy-0.onnx, ... of other libraries
    results/            one file for each policy, as `swarmdata evaluate --out` writes them

Nothing in it can be executed.
"""

import hashlib
from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, date, datetime
from pathlib import Path
from typing import Any, Literal

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
from swarmdata.runtime.output_folder import OutputKind, check_output, filled
from swarmdata.runtime.regular_files import read_regular
from swarmdata.specs.frozen import Frozen
from swarmdata.specs.origins import task_of
from swarmdata.specs.plain_names import Sha256
from swarmdata.specs.recipe import Recipe
from swarmdata.specs.task_spec import TaskSpec

ENTRY, RESULTS = "entry.json", "results"

ENTRY_FOLDER = OutputKind("leaderboard entry")

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
    submitted: date | None = None  # day of UTC; older entries say none
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
        SpecError: the task has several sides, a run was trained on other data or in other
            conditions, runs have other settings than each other, there are fewer than
            `LEAST_SEEDS` policies, they are too large, or a text is not allowed.
        UnknownNameError: no such published dataset.
        OutputError: the folder has other files.
    """
    check_output(out, ENTRY_FOLDER)
    recipe, spec = find_recipe(dataset), entry_task(dataset)
    digest = published()[recipe.id].digest
    is_onnx = all(run.suffix == ONNX_SUFFIX for run in runs)
    team = _team_of_files(runs, spec, recipe, digest) if is_onnx else _team(runs, recipe, digest)
    said: dict[str, Any] = {
        "name": name, "dataset": recipe.id, "digest": digest,
        "algorithm": team.provenances[0].algorithm or name, "license": license, "code": code,
        "trials": trials, "tuning_episodes": tuning_episodes, "is_onnx": is_onnx,
        "submitted": datetime.now(UTC).date(),
    }  # fmt: skip
    with filled(out, ENTRY_FOLDER, whole=True) as folder:
        names = [policy_name(i, is_onnx=is_onnx) for i in range(len(team.policies))]
        for index, file in enumerate(names):
            if is_onnx:
                write_file(folder / file, runs[index].read_bytes())
            else:
                save_policy(folder / file, team.policies[index])
        _check_size(folder)  # before the evaluation, which takes long
        hashes = [sha256(folder / file) for file in names]
        description = Description.parse({**said, "policies": hashes}, f"the entry {out}")
        evaluate_target(_named(team, description), n_episodes, folder / RESULTS, progress=progress)
        write_file(folder / ENTRY, description.model_dump_json(indent=1).encode() + b"\n")
        _check_size(folder)
    return description


def too_large(entry: Path) -> str | None:
    """What is wrong with the size of an entry's files; None: nothing."""
    size = sum(path.stat().st_size for path in entry.rglob("*") if not path.is_dir())
    if size <= LARGEST:
        return None
    return f"it has {size / 1e6:.1f} MB, expected at most {LARGEST / 1e6:.0f}"


def _check_size(entry: Path) -> None:
    if problem := too_large(entry):
        raise SpecError(f"the entry would be refused: {problem}. Submit smaller networks.")


def _named(team: Target, description: Description) -> Target:
    """The team with what results of an entry say of its policies."""
    said = {"label": description.name, "algorithm": description.algorithm, "run": None}
    provenances = tuple(
        each.model_copy(update={**said, "index": index, "content": content})
        for index, (each, content) in enumerate(
            zip(team.provenances, description.policies, strict=True)
        )
    )
    return replace(team, provenances=provenances)


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
    first = provenances[0]
    for each in provenances:
        if (each.algorithm, each.config) != (first.algorithm, first.config):
            raise SpecError(
                f"{each.run} ({each.algorithm}) and {first.run} ({first.algorithm}) differ in "
                "algorithm or settings, expected seeds of one configuration. Submit them apart."
            )
    return Target(targets[0].spec, policies, provenances)


def _team_of_files(files: Sequence[Path], spec: TaskSpec, recipe: Recipe, digest: str) -> Target:
    """The policies in files of ONNX, which are said to be trained on the dataset."""
    _check_number(files)
    team = onnx_target(files, spec, "onnx")
    said = {"dataset": recipe.id, "digest": digest}
    provenances = tuple(each.model_copy(update=said) for each in team.provenances)
    return replace(team, provenances=provenances)


def _check_number(policies: Sequence[object]) -> None:
    if len(policies) < LEAST_SEEDS:
        raise SpecError(
            f"there are {len(policies)} policies, expected at least {LEAST_SEEDS} training seeds; "
            "train with --seeds 5"
        )


def entry_task(dataset: str) -> TaskSpec:
    """Returns the task of a published dataset; raises SpecError if it has several sides."""
    spec = task_of(find_recipe(dataset), "a leaderboard")
    if len(spec.sides) > 1:
        raise SpecError(
            f"{dataset} is of {spec.task}, whose sides need opponents, which an entry does not "
            "have; expected a dataset of a task of one side"
        )
    return spec


def read_policy(file: Path, spec: TaskSpec) -> Policy:
    """Reads a policy of an entry."""
    return OnnxPolicy(file, spec) if file.suffix == ONNX_SUFFIX else load_policy(file)


def sha256(path: Path) -> str:
    """Returns the SHA-256 of a file, in hexadecimal digits; raises as `read_regular` does."""
    return hashlib.sha256(read_regular(path, LARGEST)).hexdigest()
