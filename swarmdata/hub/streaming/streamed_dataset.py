"""StreamedDataset: a dataset on a remote whose chunks are fetched when they are read."""

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from swarmdata.datasets.normalization import Moments
from swarmdata.datasets.views import View
from swarmdata.errors import HubError, SchemaError, SpecError
from swarmdata.hub.remotes.interface import RangeReader, Release, Remote
from swarmdata.hub.remotes.pull_dataset import Refusal, fetch_file, fetch_manifest
from swarmdata.hub.streaming.chunk_cache import ChunkCache
from swarmdata.hub.streaming.episode_blocks import EpisodeBlocks
from swarmdata.hub.streaming.remote_arrays import RemoteArrays
from swarmdata.hub.streaming.window_sampler import WindowSampler
from swarmdata.registry.published import Reference
from swarmdata.runtime.cache_folder import cache_folder
from swarmdata.specs.model_choice import Source, chosen_models
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.store.arrays.layout import RECIPE
from swarmdata.store.stored_dataset import check_listing, check_spec, read_origin, read_table
from swarmdata.types import Int, shortened

STREAMS = "streams"  # folder of chunks in the cache


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
        if self.window < 1 or self.cache_bytes < 0 or not 0 <= self.seed < 1 << 64:
            raise SpecError(
                f"{self} cannot be used, expected a window of at least 1 block, at least 0 bytes "
                "of cache and a seed from 0 to 2**64 - 1."
            )


@dataclass(frozen=True, eq=False, repr=False)
class StreamedDataset(View[WindowSampler]):
    """Episodes of a dataset on a remote, all of them or a selection.

    Its index is in memory: manifest, recipe and episode table. Everything else is fetched in chunks
    when it is read, checked, and kept in a cache of bounded size. It has what training needs;
    `read` fetches the arrays that it names, an episode all of its own.

    Attributes:
        blocks: the episodes, with the models through which they are observed.
        selection: stored episodes of this subset, int64 [n].
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
    def _rows(self) -> EpisodeBlocks:
        return self.blocks

    @property
    def _observed(self) -> TaskSpec | None:
        return self.blocks.spec

    @property
    def moments(self) -> Moments:
        """Moments of the train split: the recorded ones are exact.

        Those of a reobservation's observations are of `N_MEASURED_BLOCKS` blocks.
        """
        moments = Moments.of(self.blocks.manifest.statistics)
        if self.blocks.spec is None:
            return moments
        mean, std = self.blocks.observation_moments
        return replace(moments, observation_mean=mean, observation_std=std)

    def __repr__(self) -> str:
        return shortened(
            f"<StreamedDataset {self.id}: {len(self):,} episodes, {self.n_steps:,} steps, "
            f"{self.spec.n_agents} agents, digest {self.digest[:12]}, from {self.source}>"
        )

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
        return replace(self, blocks=replace(self.blocks, spec=changed, _last={}))

    def _sampler(self, **sizes: Any) -> WindowSampler:
        if not len(self):
            raise SchemaError("there are no episodes to sample from; widen the filter")
        return WindowSampler(
            self.blocks,
            self.selection,
            window=self.stream.window,
            order_seed=self.stream.seed,
            scale=self._action_scale(),
            view=self,
            **sizes,
        )


def open_stream(
    remote: Remote, release: Release, stream: Stream, refuse: Refusal
) -> StreamedDataset:
    """Opens a release without fetching it.

    Manifest, recipe and episode table are fetched and checked as those of a pulled dataset are.
    """
    if not isinstance(remote, RangeReader):
        raise HubError(
            f"{release.address} cannot be streamed: its kind of remote gives whole files only (it "
            "has no `read_range`). Load it without stream=True."
        )
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        manifest = fetch_manifest(remote, release, folder, refuse)
        check_listing(folder, manifest)
        fetch_file(remote, release, manifest, RECIPE, folder / RECIPE)
        origin = read_origin(folder, manifest, (folder / RECIPE).read_bytes())
        check_spec(folder, manifest, origin, widths=True)
        cache = ChunkCache(cache_folder() / STREAMS, stream.cache_bytes)
        source = RemoteArrays(remote, release, manifest, cache)
        columns = {
            array: source.rows(array, 0, manifest.n_episodes)
            for array in manifest.arrays
            if array.startswith("episodes/")
        }
        table = read_table(folder, manifest, origin, columns)
    blocks = EpisodeBlocks(source, table, origin)
    return StreamedDataset(blocks, np.arange(len(table)), stream, None, release.address)
