"""Groups of training seeds as jobs: each group is a run in a folder of its own, `OUT/seeds-...`."""

from collections.abc import Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from swarmdata.errors import BuildError
from swarmdata.learn.training.run_files import CONFIG, run_folders
from swarmdata.runtime.engines.jobs import Job
from swarmdata.runtime.engines.open_engine import LOCAL, do_jobs
from swarmdata.runtime.output_folder import check_marked

Group = tuple[int, ...]
"""Seeds that are trained together."""


def groups_of(seeds: Sequence[int], engine: str | Executor, workers: int) -> list[Group]:
    """Returns which seeds are trained together: a group for each worker of `local`, or each seed.

    Args:
        seeds: of all policies.
        engine: as `build` takes it.
        workers: processes of the engine `local`.
    """
    n_groups = workers if engine == LOCAL else len(seeds)
    return [tuple(map(int, group)) for group in np.array_split(seeds, n_groups) if len(group)]


def group_folder(out: Path, group: Group) -> Path:
    """Where a group of seeds is trained."""
    return out / f"seeds-{'-'.join(map(str, group))}"


def check_folders(out: Path, folders: Sequence[Path]) -> None:
    """Checks that runs may be trained in `out`, and that its seeds have not been grouped otherwise.

    Args:
        out: of the whole training.
        folders: of the runs that it will consist of.

    Raises:
        OutputError: a folder has files and holds no run.
        BuildError: there are other runs.
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


def train_groups(
    training: dict[str, Any],
    entry: str,
    groups: Sequence[Group],
    out: Path,
    *,
    engine: str | Executor,
    workers: int,
    length: int,
    progress: bool,
) -> None:
    """Trains each group of seeds as a job; one that fails does not stop the others.

    Args:
        training: JSON for the handler.
        entry: "module:function" that returns the handler, which gets `training`, `seeds`, `folder`.
        groups: of seeds.
        out: of the whole training.
        engine: as `build` takes it; all processes see `out` and what the training reads.
        workers: processes of the engine `local`, one thread each.
        length: of a group's training, in what the handler reports.
        progress: whether to show a bar (on standard error, if that is a terminal).

    Raises:
        BatchError: groups failed; the same call resumes from their last checkpoints.
        EngineError: the engine is unknown, or cannot be reached.
    """
    jobs = []
    for group in groups:
        folder = group_folder(out, group).resolve()
        payload = {"training": training, "seeds": list(group), "folder": str(folder)}
        jobs.append(Job(f"{folder.name} of {out.name}", payload))
    total, hidden = length * len(jobs), None if progress else True  # None: hidden, if no terminal
    with tqdm(total=total, desc=out.name, unit_scale=True, disable=hidden) as bar:

        def report(amount: int) -> None:
            bar.update(amount)

        do_jobs(
            jobs, entry, "groups of seeds",
            engine=engine, workers=workers, folder=out, report=report,
        )  # fmt: skip
