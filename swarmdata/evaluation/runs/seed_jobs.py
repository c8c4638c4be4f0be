"""Where the seeds of a training are trained: here, or in groups that are jobs of an engine."""

from collections.abc import Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from swarmdata.errors import BuildError
from swarmdata.evaluation.runs.job_options import JobOptions, do_with_bar
from swarmdata.interfaces import Policy
from swarmdata.learn.training.run_files import CONFIG, group_folder, run_folders
from swarmdata.runtime.engines.jobs import Job
from swarmdata.runtime.engines.open_engine import LOCAL
from swarmdata.runtime.output_folder import check_marked

Group = tuple[int, ...]  # seeds that are trained together

TRAINER = "swarmdata.evaluation.runs.train:seed_trainer"


class Training(Protocol):
    """A training as JSON: all but its seeds and its folder."""

    def length(self, seeds: Group, *, progress: bool) -> int: ...
    def run(self, seeds: Group, folder: Path, *, progress: bool) -> list[Policy] | None: ...
    def model_dump(self, *, mode: str) -> dict[str, Any]: ...


def train_in_groups(
    training: Training,
    out: Path,
    seeds: Group,
    part: tuple[int, int] | None,
    options: JobOptions,
) -> list[Policy] | None:
    """Trains; returns the policies if this process has trained them offline.

    Each group is a run in a folder of its own, `OUT/seeds-...`; `part` is as `train` takes it.

    Raises:
        OutputError: a folder has files and holds no run.
        BatchError: groups failed; the same call resumes from their last checkpoints.
        BuildError: there are other groups of seeds in `out`.
        EngineError: the engine is unknown, or cannot be reached.
    """
    engine, workers, progress = options["engine"], options["workers"], options["progress"]
    if part is not None and not 1 <= part[0] <= part[1]:
        raise BuildError(f"part is {part}, expected (k, N) with k from 1 to N")
    if part is None and engine == LOCAL and workers == 1:
        check_folders(out, [out])
        return training.run(seeds, out, progress=progress)
    groups = groups_of(seeds, engine, workers if part is None else part[1])
    folders = [group_folder(out, group) for group in groups]
    if part is not None:
        check_folders(out, folders)
        if part[0] > len(groups):
            return []  # there are fewer seeds than parts
        return training.run(groups[part[0] - 1], folders[part[0] - 1], progress=progress)
    length = training.length(seeds, progress=progress)  # mistakes are refused before any job
    check_folders(out, folders)
    shared = {"training": training.model_dump(mode="json")}
    jobs = [
        Job(f"{to.name} of {out.name}", {**shared, "seeds": [*group], "folder": str(to.resolve())})
        for group, to in zip(groups, folders, strict=True)
    ]
    do_with_bar(jobs, TRAINER, "groups of seeds", out, total=length * len(jobs), **options)
    return None


def groups_of(seeds: Sequence[int], engine: str | Executor, workers: int) -> list[Group]:
    """Returns which seeds train together: a group for each worker of `local`, or each seed."""
    n_groups = workers if engine == LOCAL else len(seeds)
    return [tuple(map(int, group)) for group in np.array_split(seeds, n_groups) if len(group)]


def check_folders(out: Path, folders: Sequence[Path]) -> None:
    """Checks that runs may be trained in `out`, and that its seeds have not been grouped otherwise.

    Raises:
        OutputError: a folder has files and holds no run.
    """
    check_marked(out, CONFIG, "run folder", "seeds-.*")
    for folder in folders:
        check_marked(folder, CONFIG, "run folder", "seeds-.*")
    others = [folder for folder in run_folders(out) if folder not in folders]
    if others:
        raise BuildError(
            f"{out} was trained with other groups of seeds: it holds a run in {others[0]}, "
            f"expected {folders[0]}{' and so on' if len(folders) > 1 else ''}. Pass the number of "
            "--workers, the N of --part or the kind of --engine of then, or choose another folder."
        )
