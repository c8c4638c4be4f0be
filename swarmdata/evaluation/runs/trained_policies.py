"""The policies of offline and online run folders, with their provenance."""

from pathlib import Path
from typing import Any, NamedTuple

from swarmdata.errors import CheckpointError
from swarmdata.evaluation.runs.provenance import Provenance
from swarmdata.interfaces import Policy
from swarmdata.learn.policies.policy_file import load_policy
from swarmdata.learn.training.checkpoint import load_checkpoint
from swarmdata.learn.training.run_files import CHECKPOINT, is_online, run_folders, run_hash
from swarmdata.learn.training.run_folder import Run, load_run, read_run
from swarmdata.online_algos.runs.checkpoint_selection import seeds_of
from swarmdata.online_algos.runs.online_training import OnlineRun, read_online_run
from swarmdata.online_algos.runs.seed_files import last_policy_path
from swarmdata.specs.plain_names import without_version


class Trained(NamedTuple):
    """The newest policies of a run folder, one for each seed."""

    provenances: tuple[Provenance, ...]
    spec: dict[str, Any]  # of their training, JSON
    own_spec: dict[str, Any]  # of the task with its own models
    files: list[Path]  # of online policies; or the folders of an offline run


def read_trained(folder: Path) -> Trained:
    """Reads the provenances of a run's policies.

    With them, results of `swarmdata.evaluate_parallel` can be saved like those of our tasks.

    Raises:
        CheckpointError: the folder holds no run, or its run has no checkpoint.
        BuildError: an online run has no policy yet.
    """
    first = (run_folders(folder) or (folder,))[0]
    return _online_run(folder) if is_online(first) else _offline_run(folder)


def load_policies(trained: Trained) -> list[Policy]:
    """Loads the policies, in the order of their provenances."""
    if trained.provenances[0].frames is None:
        return [policy for folder in trained.files for policy in load_run(folder)]
    return [load_policy(path) for path in trained.files]


def _online_run(folder: Path) -> Trained:
    """The newest policies of an online run, from all its processes."""
    seeds = seeds_of([folder])
    paths = [last_policy_path(*seed) for seed in seeds]
    run = read_online_run(seeds[0].folder)
    provenances = tuple(
        Provenance(
            label=folder.resolve().name,
            index=index,
            algorithm=run.algorithm,
            config=run.model_dump(mode="json")["config"],
            seed=seed.seed,
            frames=int(path.stem),
            run=str(seed.folder.resolve()),
            content=run_hash(seed.folder, seed.seed),
        )
        for index, (seed, path) in enumerate(zip(seeds, paths, strict=True))
    )
    return Trained(provenances, *_specs(run), paths)


def _offline_run(folder: Path) -> Trained:
    """The policies of an offline run as of its last checkpoint, from all its processes.

    Raises:
        CheckpointError: runs of several processes differ in more than their seeds.
    """
    folders = run_folders(folder) or (folder,)
    runs = [read_run(each) for each in folders]
    first = runs[0].model_copy(update={"seeds": ()})
    for each, run in zip(folders, runs, strict=True):
        if run.model_copy(update={"seeds": ()}) != first:
            raise CheckpointError(
                f"{each} and {folders[0]} are of different trainings, expected runs of one that "
                "differ in their seeds only. Evaluate them separately."
            )
    found: list[Provenance] = []
    for each, run in zip(folders, runs, strict=True):
        found += _offline_provenances(each, run, folder.resolve().name, len(found))
    return Trained(tuple(found), *_specs(runs[0]), list(folders))


def _specs(run: Run | OnlineRun) -> tuple[dict[str, Any], dict[str, Any]]:
    """The spec of a training, and that of the task with its own models."""
    content = run.model_dump(mode="json")
    return content["spec"], content["own_spec"] or content["spec"]


def _offline_provenances(folder: Path, run: Run, name: str, first: int) -> list[Provenance]:
    """The provenances of a run's policies, the first of which has the index `first`."""
    _, metadata = load_checkpoint(folder / CHECKPOINT)
    content = run_hash(folder, 0)  # one checkpoint holds all seeds
    return [
        Provenance(
            label=label_of(name, run.dataset),
            index=first + index,
            algorithm=run.algorithm,
            dataset=run.dataset,
            digest=run.digest,
            view=run.view,
            config=run.model_dump(mode="json")["config"],
            seed=seed,
            updates=metadata["update"],
            run=str(folder.resolve()),
            content=content,
        )
        for index, seed in enumerate(run.seeds)
    ]


def label_of(name: str, dataset: str) -> str:
    """Returns the label of a run folder: its name without the dataset's id at the end.

    `bc` and `bc-coop_nav-medium` both get the label `bc`, so that runs of an algorithm on several
    datasets share a row.
    """
    for suffix in (f"-{dataset}", f"-{without_version(dataset)}"):
        if name.endswith(suffix) and name != suffix:
            return name.removesuffix(suffix)
    return name
