"""What an offline run folder holds: its description, and its algorithm as of a checkpoint."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar

import torch
from pydantic import BeforeValidator
from torch import Tensor

from swarmdata.errors import CheckpointError
from swarmdata.interfaces import Algorithm, Policy
from swarmdata.learn.networks.dataset_statistics import Statistics
from swarmdata.learn.networks.setup import Setup, Sizes
from swarmdata.learn.training import checkpoint
from swarmdata.learn.training.run import Count, Description, kept_path
from swarmdata.learn.training.run_files import CHECKPOINT, CONFIG, KEPT, run_folders
from swarmdata.learn.training.settings import from_json
from swarmdata.perception.frames import Frame, current_fields
from swarmdata.perception.observer import features_of
from swarmdata.registry.components import OFFLINE_ALGORITHMS, make_task, resolve
from swarmdata.specs.action_scaling import choices_of
from swarmdata.specs.origins import AnySpec
from swarmdata.store.arrays.column_meanings import state_layout

COMPACT = "is_compact"
"""In the metadata of a checkpoint that lacks what policies do not need."""


def _frame_of(fields: Any) -> Any:
    return current_fields(fields) if isinstance(fields, dict) else fields


class OfflineRun(Description):
    """Everything that decides the result of an offline training run, and what it ran on."""

    CLOCK: ClassVar[str] = "update"

    dataset: str
    digest: str  # of the dataset
    view: str | None = None  # models and reward weights that were changed, JSON
    n_episodes: Count  # of the view that was trained on
    min_return: float | None = None  # least team return in it, if the algorithm chose the best
    spec: AnySpec
    own_spec: AnySpec | None = None  # as recorded, where `spec` has other models; None: `spec`
    spec_hash: str
    frame: Annotated[Frame | None, BeforeValidator(_frame_of)] = None
    """That the robots see and act in; None: the world's."""
    n_agents: Count
    observation_size: Count  # what the frame adds included
    action_size: Count
    state_size: Count
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
        kind = resolve("algorithm", OFFLINE_ALGORITHMS, self.algorithm)
        retired = getattr(kind.Config, "RETIRED", ())  # of older runs, which only act now
        settings = {name: value for name, value in self.config.items() if name not in retired}
        config = from_json(kind.Config, settings)
        setup = Setup(self.sizes, self.seeds, statistics, device, self.n_episodes)
        algorithm: Algorithm = kind(setup, config)
        return algorithm


def read_run(folder: Path) -> OfflineRun:
    """Reads a run folder's `config.json`; CheckpointError if there is none, SpecError if wrong."""
    path = folder / CONFIG
    try:
        return OfflineRun.from_file(path)
    except FileNotFoundError as error:
        parts = ", ".join(str(part) for part in run_folders(folder))
        advice = f". Its seeds were trained in parts; name these: {parts}" if parts else ""
        raise CheckpointError(
            f"{folder} is not a run folder: there is no {CONFIG}{advice}"
        ) from error


def load_run(folder: Path | str) -> list[Policy]:
    """Loads the policies of a run folder, one per seed, as of its last checkpoint.

    Raises:
        CheckpointError: the folder holds no run, or its checkpoint is absent or damaged.
    """
    return load_last(folder).policies


def load_last(
    folder: Path | str, device: torch.device | str = "cpu", path: Path | None = None
) -> "Loaded":
    """Loads the algorithm of a run folder as of its last checkpoint, a compact one too.

    Raises:
        CheckpointError: the folder holds no run, or its checkpoint is absent or damaged.
    """
    run = read_run(Path(folder))
    tensors, metadata = checkpoint.load_checkpoint(path or Path(folder) / CHECKPOINT)
    statistics, is_compact = statistics_of(tensors), bool(metadata.get(COMPACT))
    algorithm = run.build(statistics, device)
    restore(algorithm, checkpoint.part(tensors, "algorithm"), is_compact=is_compact)
    return Loaded(run, algorithm, statistics, int(metadata["update"]), is_compact)


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Loaded:
    """A run's algorithm as of one of its checkpoints."""

    run: OfflineRun
    algorithm: Algorithm
    statistics: Statistics
    update: int
    is_compact: bool  # nothing but the policies was kept, `training.compact`

    @property
    def policies(self) -> list[Policy]:
        return [self.algorithm.policy(index) for index in range(len(self.run.seeds))]


def load_algorithm(
    folder: Path | str, device: torch.device | str = "cpu", update: int | None = None
) -> Loaded:
    """Loads a run's algorithm with all its networks, as of the last update or one that was kept."""
    path = Path(folder) / CHECKPOINT if update is None else kept_path(Path(folder), update)
    loaded = load_last(folder, device, path)
    if loaded.is_compact:
        raise CheckpointError(
            f"{path} was made small: it has the policies and no critics. Train the run again, or "
            "use what needs policies only."
        )
    return loaded


def kept_updates(folder: Path) -> tuple[int, ...]:
    """The updates whose checkpoints a run has kept, in order; without `keep` it keeps none."""
    return tuple(sorted(int(path.stem) for path in (folder / KEPT).glob("*.safetensors")))


def restore(algorithm: Algorithm, state: Mapping[str, Any], *, is_compact: bool = False) -> None:
    """Gives an untrained algorithm the state of a checkpoint; what a compact one lacks stays."""
    algorithm.load_state_dict({**(algorithm.state_dict() if is_compact else {}), **state})


def statistics_of(tensors: Mapping[str, Tensor]) -> Statistics:
    """Reads the statistics back from a checkpoint's tensors."""
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
