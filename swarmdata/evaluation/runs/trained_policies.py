"""The policies of offline and online run folders, with their provenance."""

from pathlib import Path
from typing import Any, NamedTuple

from swarmdata.errors import CheckpointError
from swarmdata.evaluation.runs.provenance import Provenance
from swarmdata.interfaces import Policy
from swarmdata.learn.policies.policy_file import load_policy
from swarmdata.learn.training.checkpoint import load_checkpoint
from swarmdata.learn.training.run_files import (
    CHECKPOINT,
    Seed,
    is_online,
    last_policy_path,
    run_folders,
    run_hash,
    seeds_of,
)
from swarmdata.learn.training.run_folder import OfflineRun, load_run, read_run
from swarmdata.online_algos.runs.online_training import OnlineRun, read_online_run
from swarmdata.specs.plain_names import without_version


class Trained(NamedTuple):
    """The newest policies of a run folder, one for each seed."""

    provenances: tuple[Provenance, ...]
    spec: dict[str, Any]  # of their training, JSON
    own_spec: dict[str, Any]  # of the task with its own models
    files: list[Path]  # of online policies; or the folders of an offline run


def read_trained(folder: Path) -> Trained:
    """Reads the provenances of a run's policies, from all its processes.

    With them, results of `swarmdata.evaluate_parallel` can be saved like those of our tasks.

    Raises:
        CheckpointError: the folder holds no run, its run has no checkpoint, or runs of several
            processes differ in more than their seeds.
        BuildError: an online run has no policy yet.
    """
    folders = run_folders(folder) or (folder,)
    read = read_online_run if is_online(folders[0]) else read_run
    runs: dict[Path, OfflineRun | OnlineRun] = {each: read(each) for each in folders}
    first = runs[folders[0]]
    for each, run in runs.items():
        if run.model_copy(update={"seeds": first.seeds}) != first:
            raise CheckpointError(
                f"{each} and {folders[0]} are of different trainings, expected runs of one that "
                "differ in their seeds only. Evaluate them separately."
            )
    name = folder.resolve().name
    found = tuple(
        _provenance(seed, runs[seed.folder], name).model_copy(update={"index": index})
        for index, seed in enumerate(seeds_of([folder]))
    )
    content = first.model_dump(mode="json")
    files = list(folders)
    if isinstance(first, OnlineRun):
        files = [last_policy_path(*seed) for seed in seeds_of([folder])]
    return Trained(found, content["spec"], content["own_spec"] or content["spec"], files)


def _provenance(seed: Seed, run: OfflineRun | OnlineRun, name: str) -> Provenance:
    """The provenance of the newest policy of a seed; of an offline run, as of its checkpoint."""
    shared = {
        "algorithm": run.algorithm,
        "config": run.model_dump(mode="json")["config"],
        "seed": seed.seed,
        "run": str(seed.folder.resolve()),
        "content": run_hash(*seed),
    }
    if isinstance(run, OnlineRun):
        return Provenance(label=name, frames=int(last_policy_path(*seed).stem), **shared)
    return Provenance(
        label=label_of(name, run.dataset),
        dataset=run.dataset,
        digest=run.digest,
        view=run.view,
        updates=load_checkpoint(seed.folder / CHECKPOINT)[1]["update"],
        **shared,
    )


def load_policies(trained: Trained) -> list[Policy]:
    """Loads the policies, in the order of their provenances."""
    if trained.provenances[0].frames is None:
        return [policy for folder in trained.files for policy in load_run(folder)]
    return [load_policy(path) for path in trained.files]


def label_of(name: str, dataset: str) -> str:
    """Returns the label of a run folder: its name without the dataset's id at the end.

    `bc` and `bc-coop_nav-medium` both get the label `bc`, so that runs of an algorithm on several
    datasets share a row.
    """
    for suffix in (f"-{dataset}", f"-{without_version(dataset)}"):
        if name.endswith(suffix) and name != suffix:
            return name.removesuffix(suffix)
    return name
