"""An entry: a folder with the policies of some training seeds, their results and a description.

    entry.json          dataset and its digest, algorithm, tuning, license, hashes of the policies
    policy-0.safetensors, policy-1.safetensors, ...
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
from swarmdata.evaluation.results.policy_names import Target, find_target
from swarmdata.evaluation.results.target_evaluation import evaluate_target
from swarmdata.evaluation.runs.provenance import FilePart, Natural
from swarmdata.learn.policies.policy_file import save_policy
from swarmdata.registry.published import published
from swarmdata.registry.recipes import find_recipe
from swarmdata.runtime.atomic import write_file
from swarmdata.runtime.output_folder import check_marked
from swarmdata.specs.frozen import Frozen
from swarmdata.specs.plain_names import Sha256

ENTRY, RESULTS = "entry.json", "results"

N_EPISODES = 1000
"""Reserved episodes that an entry is evaluated on."""

LEAST_SEEDS = 5

LARGEST = 25_000_000
"""Bytes of an entry."""


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
    trials: Natural  # configurations that were tried
    tuning_episodes: Natural  # simulated episodes that settings were chosen on
    policies: tuple[Sha256, ...]  # of policy-0.safetensors, policy-1.safetensors, ...


def policy_name(index: int) -> str:
    """Returns the name of the file of a policy."""
    return f"policy-{index}.safetensors"


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
    """Makes an entry of trained runs.

    Args:
        runs: folders of runs, of one algorithm on the dataset.
        out: folder of the entry, new or empty, or of an earlier entry.
        dataset: published id.
        name: of its row.
        license: of the policies, such as `Apache-2.0`.
        code: address of the training's code.
        trials: configurations that were tried, this one included.
        tuning_episodes: simulated episodes that settings were chosen on; 0: none.
        n_episodes: reserved episodes.
        progress: whether to show progress bars.

    Raises:
        SpecError: a run was trained on other data or in other conditions, or there are fewer than
            `LEAST_SEEDS` policies.
        UnknownNameError: no such published dataset.
        OutputError: the folder has other files.
    """
    check_marked(out, ENTRY, "leaderboard entry")
    recipe = find_recipe(dataset)
    digest = published()[recipe.id].digest
    team = _team(runs, recipe.id, digest)
    for index, policy in enumerate(team.policies):
        save_policy(out / policy_name(index), policy)
    hashes = tuple(sha256(out / policy_name(index)) for index in range(len(team.policies)))
    description = Description(
        name=name, dataset=recipe.id, digest=digest, algorithm=str(team.provenances[0].algorithm),
        license=license, code=code, trials=trials, tuning_episodes=tuning_episodes,
        policies=hashes,
    )  # fmt: skip
    provenances = tuple(
        each.model_copy(update={"label": name, "index": index, "run": None, "content": content})
        for index, (each, content) in enumerate(zip(team.provenances, hashes, strict=True))
    )
    named = replace(team, provenances=provenances)
    evaluate_target(named, n_episodes, out / RESULTS, again=True, progress=progress)
    write_file(out / ENTRY, description.model_dump_json(indent=1).encode() + b"\n")
    return description


def _team(runs: Sequence[Path], dataset: str, digest: str) -> Target:
    """The policies of all runs; refuses runs on other data, or for other rewards."""
    targets = [find_target(str(run)) for run in runs]
    for run, target in zip(runs, targets, strict=True):
        _check_trained_on(run, target, dataset, digest)
    policies = tuple(policy for target in targets for policy in target.policies)
    if len(policies) < LEAST_SEEDS:
        raise SpecError(
            f"the runs have {len(policies)} policies, expected at least {LEAST_SEEDS} training "
            "seeds; train with --seeds 5"
        )
    provenances = tuple(each for target in targets for each in target.provenances)
    return Target(targets[0].spec, policies, provenances)


def _check_trained_on(run: Path, target: Target, dataset: str, digest: str) -> None:
    for each in target.provenances:
        if (each.dataset, each.digest, each.view) != (dataset, digest, None):
            view = "" if each.view is None else f" seen as {each.view}"
            raise SpecError(
                f"{run} was trained on {each.dataset} with digest {str(each.digest)[:12]}{view}, "
                f"expected {dataset} as published, {digest[:12]}"
            )


def sha256(path: Path) -> str:
    """Returns the SHA-256 of a file, in hexadecimal digits."""
    return hashlib.sha256(path.read_bytes()).hexdigest()
