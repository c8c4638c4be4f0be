"""A run folder: what was trained on what, its losses, its learning curve, its checkpoint."""

import csv
import dataclasses
import io
import platform
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import torch
from pydantic import Field
from torch import Tensor

from swarmdata import __version__
from swarmdata.datasets.action_scaling import choices_of
from swarmdata.errors import CheckpointError
from swarmdata.interfaces import Algorithm, Policy
from swarmdata.learn.networks.dataset_statistics import Statistics
from swarmdata.learn.networks.setup import Setup
from swarmdata.learn.networks.sizes import Sizes
from swarmdata.learn.training import checkpoint
from swarmdata.learn.training.overrides import from_json
from swarmdata.learn.training.run_files import CHECKPOINT, CONFIG, KEPT
from swarmdata.perception.frames import Frame
from swarmdata.perception.observer import features_of
from swarmdata.registry.components import OFFLINE_ALGORITHMS, make_task, resolve
from swarmdata.runtime.atomic import disk_full_explained, write_file
from swarmdata.specs.frozen import Frozen
from swarmdata.specs.origins import AnySpec
from swarmdata.store.arrays.column_meanings import state_layout

COMPACT = "is_compact"
"""In the metadata of a checkpoint that lacks what policies do not need."""

Count = Annotated[int, Field(ge=1)]


class Run(Frozen):
    """Everything that decides the result of an offline training run, and what it ran on."""

    format_version: Literal[1] = 1
    algorithm: str
    config: dict[str, Any]  # of the algorithm, every default written out
    dataset: str
    digest: str  # of the dataset
    view: str | None = (
        None  # models and reward weights that were changed, JSON; `spec` has the models
    )
    n_episodes: Count  # of the view that was trained on
    min_return: float | None = None  # least team return in it, if the algorithm chose the best
    spec: AnySpec
    own_spec: AnySpec | None = None  # as recorded, where `spec` has other models; None: `spec`
    spec_hash: str
    frame: Frame | None = None  # that the robots see and act in; None: the world's
    n_agents: Count
    observation_size: Count  # what the frame adds included
    action_size: Count
    state_size: Count
    seeds: Annotated[tuple[int, ...], Field(min_length=1)]
    log_every: Count
    checkpoint_every: Count
    evaluate_every: Count | None
    device: str
    versions: dict[str, str]

    @property
    def sizes(self) -> Sizes:
        """Numbers of agents and features, the choices of a recorded environment, frames."""
        task = None if self.spec.world is None else make_task(self.spec.world)
        robots, vectors = state_layout(task, self.state_size)  # those in memory may be others
        return Sizes(
            n_agents=self.n_agents,
            observation=self.observation_size,
            action=self.action_size,
            state=self.state_size,
            choices=choices_of(self.spec),
            frame=self.frame,
            robot_columns=robots,
            state_vectors=vectors,
            features=() if task is None else tuple(f.name for f in features_of(task)),
        )

    def build(self, statistics: Statistics, device: torch.device | str) -> Algorithm:
        """Makes the algorithm as it is before its first update.

        Raises:
            SpecError: a setting has another name now, which the message gives.
        """
        kind = resolve("algorithm", OFFLINE_ALGORITHMS, self.algorithm)
        config = from_json(kind.Config, self.config)
        setup = Setup(self.sizes, self.seeds, statistics, device, self.n_episodes)
        algorithm: Algorithm = kind(setup, config)
        return algorithm


def versions(*, is_compiled: bool = False) -> dict[str, str]:
    """Versions of what the bits of a run depend on.

    Args:
        is_compiled: whether torch.compile makes the kernels, which round differently.
    """
    compiler = {"inductor": torch.__version__} if is_compiled else {}
    return compiler | {
        "swarmdata": __version__,
        "torch": torch.__version__,
        "numpy": np.__version__,
        "python": platform.python_version(),
    }


def read_run(folder: Path) -> Run:
    """Reads a run folder's `config.json`.

    Raises:
        CheckpointError: there is none.
        SpecError: it is malformed.
    """
    path = folder / CONFIG
    try:
        return Run.from_file(path)
    except FileNotFoundError as error:
        raise CheckpointError(f"{folder} is not a run folder: there is no {CONFIG}") from error


def load_run(folder: Path | str, device: torch.device | str = "cpu") -> list[Policy]:
    """Loads the policies of a run folder, one per seed, as of its last checkpoint.

    Raises:
        CheckpointError: the folder holds no run, or its checkpoint is absent or damaged.
    """
    return load_last(folder, device).policies


def load_last(folder: Path | str, device: torch.device | str = "cpu") -> "Loaded":
    """Loads the algorithm of a run folder as of its last checkpoint, a compact one too.

    Raises:
        CheckpointError: the folder holds no run, or its checkpoint is absent or damaged.
    """
    return _load(Path(folder), CHECKPOINT, device)


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Loaded:
    """A run's algorithm as of one of its checkpoints."""

    run: Run
    algorithm: Algorithm
    statistics: Statistics
    update: int
    is_compact: bool  # nothing but the policies was kept, `training.compact`

    @property
    def policies(self) -> list[Policy]:
        """One per seed."""
        return [self.algorithm.policy(index) for index in range(len(self.run.seeds))]


def load_algorithm(
    folder: Path | str, device: torch.device | str = "cpu", update: int | None = None
) -> Loaded:
    """Loads the algorithm of a run folder with all its networks.

    Args:
        folder: of the run.
        device: where it computes.
        update: of a checkpoint that was kept; None for the last one.

    Raises:
        CheckpointError: the folder holds no run, the checkpoint is absent or damaged, or it has
            only what policies need (`training.compact`).
    """
    path = Path(folder) / CHECKPOINT if update is None else kept_path(Path(folder), update)
    loaded = _load(Path(folder), path.relative_to(folder), device)
    if loaded.is_compact:
        raise CheckpointError(
            f"{path} was made small: it has the policies and no critics. Train the run again, or "
            "use what needs policies only."
        )
    return loaded


def _load(folder: Path, name: Path | str, device: torch.device | str) -> Loaded:
    """What a checkpoint of a run holds."""
    run = read_run(folder)
    tensors, metadata = checkpoint.load_checkpoint(folder / name)
    statistics, is_compact = statistics_of(tensors), bool(metadata.get(COMPACT))
    algorithm = run.build(statistics, device)
    restore(algorithm, checkpoint.part(tensors, "algorithm"), is_compact=is_compact)
    return Loaded(run, algorithm, statistics, int(metadata["update"]), is_compact)


def kept_path(folder: Path, update: int) -> Path:
    """The checkpoint that a run has kept of an update."""
    return folder / KEPT / f"{update}.safetensors"


def kept_updates(folder: Path) -> tuple[int, ...]:
    """The updates whose checkpoints a run has kept, in order; without `keep` it keeps none."""
    return tuple(sorted(int(path.stem) for path in (folder / KEPT).glob("*.safetensors")))


def restore(algorithm: Algorithm, state: Mapping[str, Any], *, is_compact: bool = False) -> None:
    """Gives an untrained algorithm the state of a checkpoint.

    Args:
        algorithm: as it was built.
        state: what its `state_dict` returned; of a compact checkpoint, what its policies need.
        is_compact: whether the rest is to stay as it was built.
    """
    algorithm.load_state_dict({**(algorithm.state_dict() if is_compact else {}), **state})


def statistics_of(tensors: Mapping[str, Tensor]) -> Statistics:
    """Reads the statistics back from a checkpoint's tensors.

    Raises:
        CheckpointError: an older swarmdata wrote them, with fewer.
    """
    values: dict[str, Any] = {
        name: tensor.numpy() if tensor.ndim else tensor.item()
        for name, tensor in checkpoint.part(tensors, "statistics").items()
    }
    expected = {field.name for field in dataclasses.fields(Statistics)}
    if missing := sorted(expected - values.keys()):
        raise CheckpointError(
            f"the checkpoint lacks the statistics {', '.join(missing)}: an older swarmdata wrote "
            "it, whose networks were others. Train again, or use that version."
        )
    return Statistics(**values)


def tensors_of(statistics: Statistics) -> dict[str, Tensor]:
    """Returns the statistics as float64 tensors for a checkpoint."""
    return {
        f"statistics.{field.name}": torch.tensor(
            getattr(statistics, field.name), dtype=torch.float64
        )
        for field in dataclasses.fields(statistics)
    }


class Table:
    """A CSV file of a run: rows are appended, and dropped beyond the update a run resumes from.

    Args:
        path: of the file.
        columns: names after the first two.
        last: rows of a later time are dropped.
        keys: names of the first two: what counts the time, and who the row is about.
    """

    def __init__(
        self,
        path: Path,
        columns: Sequence[str],
        last: int,
        keys: tuple[str, str] = ("update", "seed"),
    ) -> None:
        self.path = path
        self.columns = (*keys, *columns)
        kept: list[list[str]] = []
        if path.exists():
            with path.open(newline="", encoding="utf-8") as file:
                # a row that a crash cut short is later than the checkpoint, and is dropped
                rows = [row for row in csv.reader(file) if len(row) == len(self.columns)]
            kept = [row for row in rows if row[0].isdecimal() and int(row[0]) <= last]
        write_file(path, _csv([self.columns, *kept]))

    def append(self, now: int, who: int, values: Mapping[str, float]) -> None:
        """Adds a row; a value that was not measured stays empty."""
        cells = [format(values[c], ".6g") if c in values else "" for c in self.columns[2:]]
        with disk_full_explained(self.path), self.path.open("ab") as file:
            file.write(_csv([(str(now), str(who), *cells)]))


def _csv(rows: Sequence[Sequence[str]]) -> bytes:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue().encode()
