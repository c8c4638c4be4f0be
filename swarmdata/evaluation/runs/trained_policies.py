"""The policies of offline and online run folders, with their provenance, for any task."""

from pathlib import Path
from typing import Any, NamedTuple

from swarmdata.errors import CheckpointError, PolicyFitError, SpecError
from swarmdata.evaluation.runs.provenance import Provenance
from swarmdata.interfaces import Policy
from swarmdata.learn.policies.policy_file import load_policy
from swarmdata.learn.policies.torch_policy import SetPolicy
from swarmdata.learn.training.checkpoint import load_checkpoint
from swarmdata.learn.training.run_files import (
    CHECKPOINT,
    Seed,
    is_online,
    last_policy_path,
    run_folders,
    run_hash,
    saved_policies,
    seeds_of,
)
from swarmdata.learn.training.run_folder import OfflineRun, load_run, read_run
from swarmdata.online_algos.runs.online_training import OnlineRun, read_online_run
from swarmdata.perception.observer import features_of
from swarmdata.registry.components import make_task
from swarmdata.specs.model_choice import check_senses
from swarmdata.specs.origins import SideSpec
from swarmdata.specs.plain_names import without_version
from swarmdata.specs.task_spec import TaskSpec


class Trained(NamedTuple):
    """The newest policies of a run folder, one for each seed, or all of an online run."""

    provenances: tuple[Provenance, ...]
    spec: dict[str, Any]  # of their training, JSON
    own_spec: dict[str, Any]  # of the task with its own models
    files: list[Path]  # of online policies; or the folders of an offline run
    folder: Path  # of the whole run

    @property
    def side(self) -> SideSpec | None:
        """The side that it was trained for, None for whole teams."""
        is_side = self.spec.get("kind") == "side"
        return SideSpec.parse(self.spec, str(self.folder)) if is_side else None

    def task(self, advice: str) -> TaskSpec:
        """Returns the task of the training; `advice`: what to do with a run on a recording."""
        if (own := self.side) is not None:
            raise SpecError(
                f"{self.folder} was trained for the side {own.side} of {own.whole.task}, and does "
                "not act alone. Evaluate it with opponents (--opponents NAME)"
            )
        if self.spec.get("kind") == "recorded":
            raise SpecError(
                f"{self.folder} was trained on a recording of {self.spec['task']}, which this "
                f"library cannot run. {advice}"
            )
        return TaskSpec.parse(self.spec, str(self.folder))

    def policies(self) -> list[Policy]:
        """Loads the policies, in the order of their provenances."""
        if self.provenances[0].frames is None:
            return [policy for folder in self.files for policy in load_run(folder)]
        return [load_policy(path) for path in self.files]

    def with_earlier(self) -> "Trained":
        """All policies that an online run has saved, seed by seed in the order of training."""
        saved = [
            (each.model_copy(update={"frames": int(file.stem)}), file)
            for each in self.provenances
            for file in saved_policies(Path(str(each.run)), each.seed or 0)
        ]
        return self._replace(
            provenances=tuple(each for each, _ in saved), files=[file for _, file in saved]
        )

    def fitted(self, offered: TaskSpec, advice: str) -> tuple[Policy, ...]:
        """Loads the policies, one per seed, for another spec than that of their training.

        Policies over sets act with other numbers of robots and slots; all others need those of
        their training. `advice`: see `task`.

        Raises:
            SpecError: the vector that the policies' frame turns with is not observed.
        """
        policies, trained = self.policies(), self.task(advice)
        if offered == trained:
            return tuple(policies)
        _check_robots(self.folder, trained, offered)
        known, seen = (features_of(make_task(spec)) for spec in (trained, offered))
        fitted: list[Policy] = []
        for policy in policies:
            if isinstance(policy, SetPolicy) and trained.action_size == offered.action_size:
                fitted.append(policy.fitted(seen, offered.robots))
                continue
            if trained.n_agents != offered.n_agents and not isinstance(policy, SetPolicy):
                raise PolicyFitError(
                    f"{self.folder} was trained with {trained.n_agents} robots and cannot act with "
                    f"{offered.n_agents}: its network sees the robot's number. Evaluate it with "
                    f"{trained.n_agents} robots, or train with --set policy_network=deep_sets."
                )
            check_senses(str(self.folder), trained, offered, known, seen)
            fitted.append(policy)
        return tuple(fitted)


def read_trained(folder: Path) -> Trained:
    """Reads the provenances of a run's policies, from all its processes.

    With them, results of `swarmdata.evaluate_parallel` can be saved like those of our tasks.

    Raises:
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
    seeds, name = seeds_of([folder]), folder.resolve().name
    found = tuple(_provenance(k, seed, runs[seed.folder], name) for k, seed in enumerate(seeds))
    content = first.model_dump(mode="json")
    files = list(folders)
    if isinstance(first, OnlineRun):
        files = [last_policy_path(*seed) for seed in seeds]
    own = content["own_spec"] or content["spec"]
    return Trained(found, content["spec"], own, files, folder)


def _provenance(index: int, seed: Seed, run: OfflineRun | OnlineRun, name: str) -> Provenance:
    """The provenance of the newest policy of a seed; of an offline run, as of its checkpoint."""
    shared = {
        "index": index,
        "algorithm": run.algorithm,
        "config": run.model_dump(mode="json")["config"],
        "seed": seed.seed,
        "run": str(seed.folder.resolve()),
        "content": run_hash(*seed),
    }
    where = f"the run {seed.folder}, whose folder's name is its label; rename it"
    if isinstance(run, OnlineRun):
        frames = int(last_policy_path(*seed).stem)
        return Provenance.parse({"label": name, "frames": frames, **shared}, where)
    trained = {
        "label": label_of(name, run.dataset),
        "dataset": run.dataset,
        "digest": run.digest,
        "view": run.view,
        "updates": load_checkpoint(seed.folder / CHECKPOINT)[1]["update"],
    }
    return Provenance.parse({**trained, **shared}, where)


def _check_robots(run: Path, trained: TaskSpec, offered: TaskSpec) -> None:
    """Refuses robots for which actions would mean something else."""
    known, new = (
        " and ".join(sorted({f"{r.dynamics} with {r.command} commands" for r in spec.robots}))
        for spec in (trained, offered)
    )
    if known != new:
        raise PolicyFitError(
            f"{run} was trained on robots that are {known}, and cannot drive robots that are {new}."
            " Evaluate it in a task with robots as in its training."
        )


def label_of(name: str, dataset: str) -> str:
    """Returns the label of a run folder: its name without the dataset's id at the end.

    `bc` and `bc-coop_nav-medium` both get the label `bc`, so that runs of an algorithm on several
    datasets share a row.
    """
    for suffix in (f"-{dataset}", f"-{without_version(dataset)}"):
        if name.endswith(suffix) and name != suffix:
            return name.removesuffix(suffix)
    return name
