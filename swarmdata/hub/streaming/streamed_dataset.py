"""StreamedDataset: a dataset on a remote whose chunks are fetched when they are read."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, SupportsIndex, cast, overload

import numpy as np
from numpy.typing import NDArray

from swarmdata.datasets.action_scaling import action_scale
from swarmdata.datasets.normalization import Moments, Statistics
from swarmdata.datasets.views import chosen, stored_number, torch_batches
from swarmdata.errors import SchemaError, SpecError
from swarmdata.hub.streaming.episode_blocks import EpisodeBlocks
from swarmdata.hub.streaming.window_sampler import WindowSampler
from swarmdata.interfaces import VecEnv
from swarmdata.registry.components import make_env
from swarmdata.registry.published import Reference, score_in
from swarmdata.specs.model_choice import Ranges, Source, chosen_models, models_of, with_models
from swarmdata.specs.origins import Origin, Spec, task_of
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.store import SPLITS, EpisodeTable
from swarmdata.store.arrays.layout import ALL_FIELDS
from swarmdata.store.arrays.running_moments import Moments as RunningMoments
from swarmdata.types import Double, Episode, Int, shortened

N_MEASURED_BLOCKS = 16
"""Blocks on which the observations of other sensors are measured to normalize them."""


@dataclass(frozen=True)
class Stream:
    """How a dataset is streamed.

    Attributes:
        window: blocks of about 10,000 joint steps that are in memory, and shuffled together.
        cache_bytes: most bytes of chunks that are kept on the disk, of all streamed datasets
            together; 0: none.
        seed: of the order of the blocks.
    """

    window: int = 16
    cache_bytes: int = 4 << 30
    seed: int = 0

    def __post_init__(self) -> None:
        """Checks the sizes.

        Raises:
            SpecError: a size is too small.
        """
        if self.window < 1 or self.cache_bytes < 0 or not 0 <= self.seed < 1 << 64:
            raise SpecError(
                f"{self} cannot be used, expected a window of at least 1 block, at least 0 bytes "
                "of cache and a seed from 0 to 2**64 - 1."
            )


@dataclass(frozen=True, eq=False, repr=False)
class StreamedDataset:
    """Episodes of a dataset on a remote, all of them or a selection.

    Its index is in memory: manifest, recipe and episode table. Everything else is fetched in chunks
    when it is read, checked, and kept in a cache of bounded size. It has what training needs.

    Attributes:
        blocks: the episodes, with the models through which they are observed.
        selection: stored episodes of this view, int64 [n].
        stream: how it is streamed.
        references: anchors of the normalized score, if known.
        source: address of the release.
    """

    blocks: EpisodeBlocks
    selection: Int
    stream: Stream
    references: Reference | None
    source: str

    @property
    def id(self) -> str:
        """Versioned name, such as `coop_nav-medium-v1`."""
        return self.blocks.source.manifest.id

    @property
    def digest(self) -> str:
        """Logical SHA-256 of the whole dataset, hex."""
        return self.blocks.source.manifest.digest

    @property
    def recipe(self) -> Origin:
        """Where the dataset comes from, such as the recipe that generates it."""
        return self.blocks.origin

    @property
    def spec(self) -> Spec:
        """What was recorded; of a reobservation, the task with the new models."""
        return self.recipe.spec if self.blocks.spec is None else self.blocks.spec

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
        return task_of(self.recipe, "this") if self.blocks.spec is None else self.blocks.spec

    @property
    def view(self) -> str | None:
        """Canonical JSON of a reobservation's two models, None for the recorded dataset."""
        if self.blocks.spec is None:
            return None
        return json.dumps(models_of(self.blocks.spec), sort_keys=True, separators=(",", ":"))

    @property
    def statistics(self) -> Statistics:
        """What normalizes observations and rewards, the same in every selection."""
        return Statistics.of(self.moments)

    @property
    def moments(self) -> Moments:
        """Moments of the train split: the recorded ones are exact.

        Those of a reobservation's observations are of `N_MEASURED_BLOCKS` blocks.
        """
        moments = Moments.of(self.blocks.source.manifest.statistics)
        if self.blocks.spec is None:
            return moments
        mean, std = self._measured()
        return replace(moments, observation_mean=mean, observation_std=std)

    def _measured(self) -> tuple[Double, Double]:
        train = self.blocks.table.split == SPLITS.index("train")
        owners = np.searchsorted(self.blocks.firsts, np.flatnonzero(train), side="right") - 1
        live = np.unique(owners)
        places = np.arange(min(N_MEASURED_BLOCKS, len(live))) * len(live)
        moments = RunningMoments()
        for block in live[places // min(N_MEASURED_BLOCKS, len(live))].tolist():
            rows = self.blocks.read(block, ("observations",))["observations"]
            episodes = slice(int(self.blocks.firsts[block]), int(self.blocks.firsts[block + 1]))
            chosen = np.repeat(train[episodes], self.blocks.table.lengths[episodes] + 1)
            moments.add(rows[chosen].reshape(-1, rows.shape[-1]))
        mean, std = moments.result()
        return np.array(mean), np.array(std)

    @property
    def episodes(self) -> EpisodeTable:
        """One row per episode of this view."""
        return self.blocks.table.take(self.selection)

    @property
    def n_episodes(self) -> int:
        """Episodes of this view."""
        return len(self.selection)

    @property
    def n_steps(self) -> int:
        """Joint steps of this view."""
        return int(self.blocks.table.lengths[self.selection].sum())

    def __len__(self) -> int:
        """Number of episodes."""
        return len(self.selection)

    def __repr__(self) -> str:
        """Shows identity and size."""
        return shortened(
            f"<StreamedDataset {self.id}: {len(self):,} episodes, {self.n_steps:,} steps, "
            f"{self.spec.n_agents} agents, digest {self.digest[:12]}, from {self.source}>"
        )

    @overload
    def __getitem__(self, index: SupportsIndex) -> Episode: ...
    @overload
    def __getitem__(self, index: slice) -> "StreamedDataset": ...
    def __getitem__(self, index: SupportsIndex | slice) -> "Episode | StreamedDataset":
        """Returns one episode, in memory, or the view of a slice of episodes.

        Raises:
            IndexError: there is no such episode.
            SchemaError: the index is neither a whole number nor a slice.
            HubError: a chunk could not be fetched.
        """
        if isinstance(index, slice):
            return replace(self, selection=self.selection[index])
        lazy = _LazyEpisode(self.blocks, stored_number(self, index), _LastBlock(self.blocks))
        return lazy.whole()

    def __iter__(self) -> Iterator[Episode]:
        """Yields the episodes in stored order, whose arrays are fetched when they are looked at."""
        last = _LastBlock(self.blocks)
        for episode in self.selection.tolist():
            yield cast(Episode, _LazyEpisode(self.blocks, episode, last))

    def split(self, name: Literal["train", "validation", "test"]) -> "StreamedDataset":
        """Returns the view of one stored split.

        Raises:
            UnknownNameError: another name.
        """
        return self.filter(split=name)

    def filter(
        self,
        *,
        success: bool | None = None,
        min_return: float | None = None,
        max_return: float | None = None,
        policy: str | None = None,
        split: str | None = None,
    ) -> "StreamedDataset":
        """Returns the view of the episodes that meet every condition, as `Dataset.filter` does."""
        mask = chosen(
            self.episodes, self.recipe, success=success, min_return=min_return,
            max_return=max_return, policy=policy, split=split,
        )  # fmt: skip
        return replace(self, selection=self.selection[mask])

    def reobserve(
        self, observation: Source | None = None, communication: Source | None = None
    ) -> "StreamedDataset":
        """Returns the same episodes as robots with other sensors and radios would observe them.

        They are observed again block by block, when they are read; recorded observations are not
        fetched. Otherwise as `Dataset.reobserve`.

        Raises:
            UnknownNameError: no such model.
            SpecError: a malformed model, or learned messages that were not recorded.
        """
        spec = chosen_models(self.task, observation, communication, own=self.own_spec.world)
        changed = None if spec == self.recipe.spec else spec
        return replace(self, blocks=replace(self.blocks, spec=changed))

    def sampler(
        self,
        batch_size: int = 256,
        *,
        horizon: int | None = None,
        burn_in: int | None = None,
        seed: int = 0,
    ) -> WindowSampler:
        """Returns an endless stream of batches, uniform over a moving window of blocks.

        Args:
            batch_size: transitions or windows of steps in a batch, B.
            horizon: as of `Dataset.sampler`.
            burn_in: as of `Dataset.sampler`.
            seed: of the stream.

        Raises:
            SchemaError: the view is empty, a size is below 1, or continuous actions have no bounds.
        """
        if not len(self):
            raise SchemaError("there are no episodes to sample from; widen the filter")
        spec = self.spec
        return WindowSampler(
            self.blocks,
            self.selection,
            window=self.stream.window,
            order_seed=self.stream.seed,
            batch_size=batch_size,
            horizon=horizon,
            burn_in=burn_in,
            seed=seed,
            scale=action_scale(spec) if spec.action_kind == "continuous" else None,
            view=self,
        )

    def to_torch(
        self,
        batch_size: int = 256,
        *,
        horizon: int | None = None,
        burn_in: int | None = None,
        seed: int = 0,
    ) -> Any:
        """Returns the batches of `sampler` for a torch `DataLoader`, as `Dataset.to_torch` does."""
        return torch_batches(
            self, batch_size=batch_size, horizon=horizon, burn_in=burn_in, seed=seed
        )

    def make_env(
        self, n_copies: int = 1, *, n_threads: int = 1, backend: str | None = None,
        randomization: Ranges | None = None,
    ) -> VecEnv:  # fmt: skip
        """Builds copies of the world that was recorded; arguments as of `Dataset.make_env`."""
        spec = with_models(self.task, backend=backend, randomization=randomization)
        return make_env(spec, n_copies, n_threads=n_threads)

    def normalized_score(self, returns: Sequence[float] | Double | float) -> Double:
        """Returns the score of team returns, as `Dataset.normalized_score` does.

        Raises:
            SchemaError: the references of this dataset's task are not known.
        """
        return score_in(self.id, returns, self.references)


class _LastBlock:
    """The arrays of the block that was read last, each fetched when it is asked for."""

    def __init__(self, blocks: EpisodeBlocks) -> None:
        self._blocks, self._number = blocks, -1
        self._held: dict[str, NDArray[Any]] = {}

    def array(self, block: int, name: str) -> NDArray[Any]:
        """One array of a block."""
        if block != self._number:
            self._number, self._held = block, {}
        if name not in self._held:
            self._held |= self._blocks.read(block, (name,))
        return self._held[name]


class _LazyEpisode:
    """What `Episode` has; an array is fetched when it is first looked at."""

    def __init__(self, blocks: EpisodeBlocks, number: int, last: _LastBlock) -> None:
        self._blocks, self._number, self._last = blocks, number, last
        self.seed = int(blocks.table.seeds[number])
        self.policy = int(blocks.table.policy[number])
        self.end_reason = int(blocks.table.end_reason[number])
        self.layout = blocks.table.layouts[number]

    def __len__(self) -> int:
        return int(self._blocks.table.lengths[self._number])

    def __getattr__(self, name: str) -> Any:
        if name not in Episode.__slots__:
            return getattr(Episode, name).__get__(self)  # a property, such as `team_return`
        if name not in self._blocks.source.manifest.arrays:
            return None
        block = int(np.searchsorted(self._blocks.firsts, self._number, side="right")) - 1
        first = int(self._blocks.table.starts[self._number] - self._blocks.first_steps[block])
        n_rows = len(self)
        if ALL_FIELDS[name].rows == "states":
            first, n_rows = first + self._number - int(self._blocks.firsts[block]), n_rows + 1
        return self._last.array(block, name)[first : first + n_rows]

    def whole(self) -> Episode:
        """The episode with all its arrays."""
        return Episode(**{name: getattr(self, name) for name in Episode.__slots__})
