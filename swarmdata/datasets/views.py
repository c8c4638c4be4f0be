"""What all views of data share, whether their rows are in files, streamed, or mixed of several."""

import json
import math
import operator
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from numbers import Real
from typing import (
    TYPE_CHECKING,
    Any,
    Generic,
    Literal,
    Protocol,
    Self,
    SupportsIndex,
    TypeVar,
    cast,
    overload,
)

import numpy as np
from numpy.typing import NDArray

from swarmdata.datasets.normalization import Moments, Statistics
from swarmdata.datasets.sampling import BatchStream, RowSampler
from swarmdata.errors import SchemaError, UnknownNameError
from swarmdata.registry.published import Reference, normalized_score
from swarmdata.specs.action_scaling import ActionScale, action_scale
from swarmdata.specs.model_choice import Ranges, models_of, with_models
from swarmdata.specs.origins import Origin, SideSpec, Spec, task_of
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.store import SPLITS, EpisodeTable, Manifest
from swarmdata.types import (
    OPTIONAL_STATE_FIELDS,
    OPTIONAL_STEP_FIELDS,
    STATE_FIELDS,
    STEP_FIELDS,
    Bool,
    Double,
    Episode,
    Int,
)

if TYPE_CHECKING:
    from swarmdata.interfaces import VecEnv
    from swarmdata.perception.frames import Frame

S = TypeVar("S", bound=BatchStream)
R = TypeVar("R", bound=RowSampler)

TIME_ARRAYS = (*STATE_FIELDS, *STEP_FIELDS, *OPTIONAL_STATE_FIELDS, *OPTIONAL_STEP_FIELDS)
"""The arrays of an `Episode`, those that not every dataset has at the end."""


class RowSource(Protocol):
    """Where the rows of a dataset are."""

    @property
    def manifest(self) -> Manifest: ...
    @property
    def recipe(self) -> Origin: ...
    @property
    def table(self) -> EpisodeTable: ...  # all stored episodes
    def rows(self, number: int, name: str) -> NDArray[Any]: ...  # of an array in an episode


Choice = Callable[[EpisodeTable, Origin], Bool]
"""Which episodes of a table are wanted, [n]; the origin names their policies."""


class TrainingData(ABC, Generic[S]):
    """Episodes that are trained on; subclasses are frozen dataclasses."""

    __slots__ = ()

    @property
    @abstractmethod
    def moments(self) -> Moments:
        """Moments of observations and rewards, from which algorithms of this library learn."""

    @abstractmethod
    def _sampler(self, **sizes: Any) -> S: ...

    def sampler(
        self,
        batch_size: int = 256,
        *,
        horizon: int | None = None,
        burn_in: int | None = None,
        seed: int = 0,
    ) -> S:
        """Returns an endless stream of batches.

        They are uniform over the transitions: of a streamed dataset over those of a moving window
        of blocks, of a mixture each row is drawn with the weights.

        Actions are in [-1, 1], the range in which policies act: bounded continuous actions of a
        recorded environment are mapped affinely (`action_scaling`), discrete choices stay as they
        were recorded.

        Args:
            batch_size: transitions or windows in a batch, B.
            horizon: steps of masked windows that never cross an episode, or None for single
                transitions.
            burn_in: None: a window starts at any step. Else episodes are cut into segments of
                `horizon` steps from their start on, and a window is a segment with the `burn_in`
                steps before it; where these are before the episode, `mask` is False. Segments are
                chosen in proportion to their steps.
            seed: of the stream.

        Raises:
            SchemaError: there are no episodes, a size is below 1, or continuous actions have no
                bounds.
        """
        return self._sampler(batch_size=batch_size, horizon=horizon, burn_in=burn_in, seed=seed)

    @abstractmethod
    def read(self, *names: str) -> Iterator[tuple[NDArray[Any], ...]]:
        """Yields some arrays of each episode in stored order, and reads no others.

        Raises:
            UnknownNameError: a dataset has no such array with rows over time.
        """

    @abstractmethod
    def _chosen(self, choice: Choice) -> Self:
        """The same data with fewer episodes."""

    def filter(
        self,
        *,
        success: bool | None = None,
        min_return: float | None = None,
        max_return: float | None = None,
        policy: str | None = None,
        split: str | None = None,
    ) -> Self:
        """Returns the subset of the episodes that meet every given condition.

        A part of a mixture without such episodes is left out; the other weights keep their
        proportions.

        Args:
            success: whether the task was solved.
            min_return: least team return, included.
            max_return: greatest team return, included.
            policy: label of a policy of the recipe.
            split: `train`, `validation` or `test`.

        Raises:
            UnknownNameError: no such policy or split.
            SchemaError: a return is no number, `success` no truth value, or no episode of a mixture
                is left.
        """
        conditions = {"success": success, "min_return": min_return, "max_return": max_return}
        return self._chosen(partial(_mask, policy=policy, split=split, **conditions))  # type: ignore[arg-type]

    @property
    def statistics(self) -> Statistics:
        """What normalizes observations and rewards, the same in every selection."""
        return Statistics.of(self.moments)

    def split(self, name: Literal["train", "validation", "test"]) -> Self:
        """Returns the subset of one stored split.

        Raises:
            UnknownNameError: another name.
            SchemaError: no part of a mixture has an episode of it.
        """
        return self.filter(split=name)

    def to_torch(
        self, batch_size: int = 256, *, horizon: int | None = None, burn_in: int | None = None,
        seed: int = 0,
    ) -> Any:  # fmt: skip
        """Returns the batches of `sampler` as a torch `IterableDataset`, for a `DataLoader`.

            >>> loader = DataLoader(dataset.to_torch(256), batch_size=None, num_workers=2)

        Its workers take turns: whatever their number, the loader yields the batches of `sampler`
        in order, as tensors, without end. Arguments and errors are those of `sampler`.

        Raises:
            MissingExtraError: torch is not installed.
        """
        from swarmdata.runtime.extras import require_extra  # noqa: PLC0415  (as torch itself)

        require_extra("torch", "torch", "to_torch")
        from swarmdata.datasets.torch_batches import TorchBatches  # noqa: PLC0415

        sizes = {"batch_size": batch_size, "horizon": horizon, "burn_in": burn_in, "seed": seed}
        return TorchBatches(self, **sizes)


class View(TrainingData[R]):
    """Episodes of one dataset, all of them or a selection."""

    __slots__ = ()

    selection: Int  # stored episodes of this subset, [n]
    references: Reference | None  # anchors of the normalized score, if known

    @property
    @abstractmethod
    def _rows(self) -> RowSource: ...

    @property
    @abstractmethod
    def _observed(self) -> TaskSpec | None:
        """The task with the models of a reobservation, None for the recorded ones."""

    @property
    def id(self) -> str:
        """Versioned name, such as `coop_nav-medium-v1`."""
        return self._rows.manifest.id

    @property
    def digest(self) -> str:
        """Logical SHA-256 of the whole dataset, hex; a subset has that of its dataset."""
        return self._rows.manifest.digest

    @property
    def recipe(self) -> Origin:
        """Where the dataset comes from, such as the recipe that generates it."""
        return self._rows.recipe

    @property
    def spec(self) -> Spec:
        """What was recorded; of a reobservation, the task with the new models; of a side, its part.

        Other rewards do not change it: policies are evaluated on those of the task.
        """
        if self._side is not None:
            return self._side
        return self.recipe.spec if self._observed is None else self._observed

    def side(self, name: str) -> Self:
        """The agents of one side alone, only of a dataset on this machine: see `Dataset.side`.

        Raises:
            SchemaError: the dataset is streamed.
        """
        raise SchemaError(
            f"{self!r} is streamed, which gives the rows of all sides, expected a dataset on this "
            f"machine to take the side {name!r} of. Load it without stream=True."
        )

    @property
    def _side(self) -> SideSpec | None:
        """The side whose rows these are, None for the rows of all agents."""
        return None

    @property
    def _has_other_rewards(self) -> bool:
        """Whether rewards and returns are not the recorded ones."""
        return False

    @property
    def own_spec(self) -> Spec:
        """What was recorded, with its own models."""
        return self.recipe.spec

    @property
    def task(self) -> TaskSpec:
        """The task that was recorded, one of this library.

        Raises:
            SpecError: the dataset was recorded in another environment.
        """
        purpose = "stepping or drawing it"
        return task_of(self.recipe, purpose) if self._observed is None else self._observed

    @property
    def frame(self) -> "Frame | None":
        """The frame in which the algorithms of this library learn; None for the world's.

        `batch.in_frame(dataset.frame)` gives what they learn from, and
        `FunctionPolicy(act, frame=dataset.frame)` turns what a policy does back. `frame_of` has
        other frames.
        """
        from swarmdata.rollouts.function_policy import frame_of  # noqa: PLC0415  (it compiles kernels)

        return frame_of(self.spec)

    @property
    def view(self) -> str | None:
        """Canonical JSON of a reobservation's two models and of the weights that were changed.

        None for the recorded dataset. Together with `digest` it identifies the content.
        """
        changed = self._changes()
        return json.dumps(changed, sort_keys=True, separators=(",", ":")) if changed else None

    def _changes(self) -> dict[str, Any]:
        return {} if self._observed is None else models_of(self._observed)

    @property
    def episodes(self) -> EpisodeTable:
        """One row per episode of this subset."""
        return self._rows.table.take(self.selection)

    @property
    def n_episodes(self) -> int:
        """Number of episodes of this subset."""
        return len(self.selection)

    @property
    def n_steps(self) -> int:
        """Number of joint steps of this subset."""
        return int(self._rows.table.lengths[self.selection].sum())

    def __len__(self) -> int:
        return len(self.selection)

    @overload
    def __getitem__(self, index: SupportsIndex) -> Episode: ...
    @overload
    def __getitem__(self, index: slice) -> Self: ...
    def __getitem__(self, index: SupportsIndex | slice) -> Episode | Self:
        """Returns one episode, or the subset of a slice of episodes.

        Raises:
            IndexError: there is no such episode.
            SchemaError: the index is neither a whole number nor a slice.
            HubError: it is streamed, and could not be fetched.
        """
        if isinstance(index, slice):
            return self._selected(self.selection[index])
        try:
            if isinstance(index, bool):
                raise TypeError
            position = operator.index(index)
        except TypeError:
            raise SchemaError(
                f"a dataset got the index {index!r:.100}, expected the number of an episode or a "
                "slice such as [:3]; `filter` selects by outcome, policy and split"
            ) from None
        if not -len(self) <= position < len(self):
            raise IndexError(f"episode {position} of {len(self)} in {self!r}")
        return self._episode(int(self.selection[position]))

    def _selected(self, selection: Int) -> Self:
        return cast(Self, replace(cast(Any, self), selection=selection))

    def _episode(self, number: int) -> Episode:
        source, table = self._rows, self._rows.table
        there = [name for name in TIME_ARRAYS if name in source.manifest.arrays]
        return Episode(
            **{name: source.rows(number, name) for name in there},
            layout=table.layouts[number],
            seed=int(table.seeds[number]),
            policy=int(table.policy[number]),
            end_reason=int(table.end_reason[number]),
        )

    def __iter__(self) -> Iterator[Episode]:
        return map(self._episode, self.selection.tolist())

    def read(self, *names: str) -> Iterator[tuple[NDArray[Any], ...]]:
        there = [name for name in TIME_ARRAYS if name in self._rows.manifest.arrays]
        for name in names:
            _index(f"array over time of {self.id}", name, there)
        for number in self.selection.tolist():
            yield tuple(self._rows.rows(number, name) for name in names)

    def _chosen(self, choice: Choice) -> Self:
        return self._selected(self.selection[choice(self.episodes, self.recipe)])

    def _action_scale(self) -> ActionScale | None:
        """What maps continuous actions to [-1, 1]; None where they are already, or are choices."""
        return action_scale(self.spec) if self.spec.action_kind == "continuous" else None

    @overload
    def make_env(
        self, n_copies: int = 1, *, n_threads: int = 1, api: Literal["vector"] = "vector",
        backend: str | None = None, randomization: Ranges | None = None,
    ) -> "VecEnv": ...  # fmt: skip
    @overload
    def make_env(
        self, n_copies: int = 1, *, api: Literal["pettingzoo"], backend: str | None = None,
        randomization: Ranges | None = None, render_mode: str | None = None,
    ) -> Any: ...  # fmt: skip
    def make_env(
        self, n_copies: int = 1, *, n_threads: int = 1, api: str = "vector",
        backend: str | None = None, randomization: Ranges | None = None,
        render_mode: str | None = None,
    ) -> Any:  # fmt: skip
        """Builds the world that was recorded.

        Args:
            n_copies: copies stepped together, E; a PettingZoo environment has one.
            n_threads: threads that step them, as `swarmdata.make_env` takes it.
            api: `vector` for a `VecEnv`, `pettingzoo` for a `ParallelEnv`.
            backend: simulator, such as `mujoco`; None: that of the recording.
            randomization: ranges from which each episode draws, such as `{"mass": (1, 2)}`; None:
                those of the recording.
            render_mode: as `swarmdata.make_env` takes it.

        Raises:
            UnknownNameError: another interface or simulator.
            SpecError: the world has nothing of that name to draw.
            MissingExtraError: the simulator is not installed.
            SchemaError: several copies or threads of a PettingZoo environment.
        """
        from swarmdata.registry.components import make_env  # noqa: PLC0415  (readers build none)

        spec = with_models(self.task, backend=backend, randomization=randomization)
        options: dict[str, Any] = {"n_threads": n_threads, "api": api, "render_mode": render_mode}
        return make_env(spec, n_copies, **options)

    def normalized_score(self, returns: Sequence[float] | Double | float) -> Double:
        """Returns 100 (R - R0) / (R_expert - R0) for each team return, same shape.

        0 is the no-skill reference (the better of a random and an idle policy), 100 the expert's
        (D4RL, Fu et al. 2020, section 4, with another zero).

        Raises:
            SchemaError: the references of this dataset's task are not known, or not in order; or
                this view has other rewards, with which the references were not measured.
        """
        if self._has_other_rewards:
            raise SchemaError(
                f"{self!r} has other rewards than its task, whose references give no score to "
                "returns of other rewards. Compute it with the dataset before `with_rewards`, from "
                "returns on the task's own rewards, such as those of `evaluate`."
            )
        if isinstance(self.spec, SideSpec):
            raise SchemaError(
                f"{self!r} has no score, because others played against it than against the "
                "references of its side. Results of evaluate(..., opponents='scripted') have one."
            )
        if self.references is None:
            raise SchemaError(
                f"{self.id} was opened without references, or has other rewards than its task, so "
                "no score can be computed. Pass Dataset.open(path, "
                "references=swarmdata.Reference(no_skill=..., expert=...))."
            )
        values = np.asarray(returns, dtype=np.float64)
        return np.asarray(normalized_score(values, self.references))


def _mask(
    table: EpisodeTable,
    origin: Origin,
    *,
    success: bool | None,
    min_return: float | None,
    max_return: float | None,
    policy: str | None,
    split: str | None,
) -> Bool:
    """Which episodes meet every given condition, [n]; None asks for nothing."""
    if not isinstance(success, bool | np.bool_ | None):
        raise SchemaError(f"success is {success!r:.100}, expected True, False or None")
    bounds: dict[str, Any] = {"min_return": min_return, "max_return": max_return}
    for name, bound in bounds.items():
        if bound is not None and (not isinstance(bound, Real) or math.isnan(bound)):
            raise SchemaError(f"{name} is {bound!r:.100}, expected a number or None")
    mask = np.ones(len(table), dtype=np.bool_)
    if success is not None:
        mask &= table.success == success
    if min_return is not None:
        mask &= table.team_return >= min_return
    if max_return is not None:
        mask &= table.team_return <= max_return
    if policy is not None:
        labels = [source.label for source in origin.policies]
        mask &= table.policy == _index(f"policy of {origin.id}", policy, labels)
    if split is not None:
        mask &= table.split == _index("split", split, SPLITS)
    return mask


def _index(kind: str, name: str, known: Sequence[str]) -> int:
    if name not in known:
        raise UnknownNameError(kind, name, known)
    return known.index(name)
