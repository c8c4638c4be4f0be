"""Where the seeds of a training are trained: here, or in groups that are jobs of an engine.

Each group is a run in a folder of its own, `OUT/seeds-...`.
"""

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from swarmdata.errors import BuildError
from swarmdata.evaluation.runs.job_options import do_with_bar
from swarmdata.interfaces import Policy
from swarmdata.learn.training.run_files import CONFIG, run_folders
from swarmdata.runtime.engines.jobs import Job
from swarmdata.runtime.engines.open_engine import LOCAL
from swarmdata.runtime.output_folder import check_marked

Group = tuple[int, ...]
"""Seeds that are trained together."""


class Training(Protocol):
    """A training as JSON: all but its seeds and its folder."""

    def length(self, seeds: Group, *, progress: bool) -> int: ...
    def run(self, seeds: Group, folder: Path, *, progress: bool) -> list[Policy] | None: ...
    def model_dump(self, *, mode: str) -> dict[str, Any]: ...


@dataclass(frozen=True)
class Where:
    """Where a training's seeds are trained, in the words of `train`."""

    out: Path
    seeds: Group
    workers: int
    engine: str | Executor
    part: tuple[int, int] | None
    progress: bool

    def train(self, training: Training, entry: str) -> list[Policy] | None:
        """Trains; returns the policies if this process has trained them offline.

        Args:
            training: what to train.
            entry: "module:function" that returns the handler of a job, which gets the training as
                JSON, `seeds` and `folder`.

        Raises:
            OutputError: a folder has files and holds no run.
            BatchError: groups failed; the same call resumes from their last checkpoints.
            BuildError: there are other groups of seeds in `out`.
            EngineError: the engine is unknown, or cannot be reached.
        """
        out, part = self.out, self.part
        if part is None and self.engine == LOCAL and self.workers == 1:
            check_folders(out, [out])
            return training.run(self.seeds, out, progress=self.progress)
        n_groups = self.workers if part is None else part[1]
        groups = groups_of(self.seeds, self.engine, n_groups)
        if part is None:  # mistakes are refused before any job
            length = training.length(self.seeds, progress=self.progress)
        check_folders(out, [group_folder(out, group) for group in groups])
        if part is None:
            self._train_groups(training.model_dump(mode="json"), entry, groups, length)
            return None
        if part[0] > len(groups):
            return []  # there are fewer seeds than parts
        group = groups[part[0] - 1]
        return training.run(group, group_folder(out, group), progress=self.progress)

    def _train_groups(
        self, training: dict[str, Any], entry: str, groups: Sequence[Group], length: int
    ) -> None:
        """Trains each group of seeds as a job; one that fails does not stop the others."""
        jobs = []
        for group in groups:
            folder = group_folder(self.out, group).resolve()
            payload = {"training": training, "seeds": list(group), "folder": str(folder)}
            jobs.append(Job(f"{folder.name} of {self.out.name}", payload))
        do_with_bar(
            jobs, entry, "groups of seeds", self.out, total=length * len(jobs),
            engine=self.engine, workers=self.workers, progress=self.progress,
        )  # fmt: skip


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
