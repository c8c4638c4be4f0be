"""The policies of offline and online run folders, with their provenance."""

from pathlib import Path
from typing import Any, NamedTuple

from swarmdata.evaluation.runs.provenance import Provenance
from swarmdata.interfaces import Policy
from swarmdata.learn.policies.policy_file import load_policy
from swarmdata.learn.training.checkpoint import load_checkpoint
from swarmdata.learn.training.run_files import CHECKPOINT, is_online, run_folders, run_hash
from swarmdata.learn.training.run_folder import load_run, read_run
from swarmdata.online_algos.runs.checkpoint_selection import seeds_of
from swarmdata.online_algos.runs.online_training import read_online_run
from swarmdata.online_algos.runs.seed_files import last_policy_path
from swarmdata.specs.plain_names import without_version


class Trained(NamedTuple):
    """The newest policies of a run folder, one for each seed."""

    provenances: tuple[Provenance, ...]
    spec: dict[str, Any]  # of their training, JSON
    files: list[Path]  # of online policies; or the folder of an offline run


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
        return load_run(trained.files[0])
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
    return Trained(provenances, run.spec.model_dump(mode="json"), paths)


def _offline_run(folder: Path) -> Trained:
    """The policies of an offline run as of its last checkpoint."""
    run = read_run(folder)
    _, metadata = load_checkpoint(folder / CHECKPOINT)
    label = label_of(folder.resolve().name, run.dataset)
    content = run_hash(folder, 0)  # one checkpoint holds all seeds
    document = run.model_dump(mode="json")
    provenances = tuple(
        Provenance(
            label=label,
            index=index,
            algorithm=run.algorithm,
            dataset=run.dataset,
            digest=run.digest,
            view=run.view,
            config=document["config"],
            seed=seed,
            updates=metadata["update"],
            run=str(folder.resolve()),
            content=content,
        )
        for index, seed in enumerate(run.seeds)
    )
    return Trained(provenances, document["spec"], [folder])


def label_of(name: str, dataset: str) -> str:
    """Returns the label of a run folder: its name without the dataset's id at the end.

    `bc` and `bc-coop_nav-medium` both get the label `bc`, so that runs of an algorithm on several
    datasets share a row.
    """
    for suffix in (f"-{dataset}", f"-{without_version(dataset)}"):
        if name.endswith(suffix) and name != suffix:
            return name.removesuffix(suffix)
    return name
