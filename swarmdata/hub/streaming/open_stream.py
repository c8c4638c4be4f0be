"""Opens a release for streaming: its index is fetched and checked, and no array over time."""

import tempfile
from pathlib import Path

import numpy as np

from swarmdata.errors import HubError
from swarmdata.hub.remotes.interface import RangeReader, Release, Remote
from swarmdata.hub.remotes.pull_dataset import Refusal, fetch_file, fetch_manifest
from swarmdata.hub.streaming.chunk_cache import ChunkCache
from swarmdata.hub.streaming.episode_blocks import EpisodeBlocks
from swarmdata.hub.streaming.remote_arrays import RemoteArrays
from swarmdata.hub.streaming.streamed_dataset import Stream, StreamedDataset
from swarmdata.store.arrays.layout import RECIPE
from swarmdata.store.cache import cache_folder
from swarmdata.store.stored_dataset import check_listing, check_spec, read_origin, read_table

STREAMS = "streams"
"""Folder of chunks in the cache."""


def open_stream(
    remote: Remote, release: Release, stream: Stream, refuse: Refusal
) -> StreamedDataset:
    """Opens a release without fetching it.

    Manifest, recipe and episode table are fetched and checked as those of a pulled dataset are.

    Args:
        remote: where from.
        release: from `remote.find`.
        stream: how it is streamed.
        refuse: returns why a dataset of this manifest is not wanted, None if it is.

    Raises:
        ChecksumError: `refuse` has a reason against it, or the remote gives wrong bytes.
        HubError: the remote gives only whole files, could not be asked, or gave what it must not.
        DatasetError: its parts contradict each other.
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
        origin = read_origin(folder, manifest, (folder / RECIPE).read_bytes(), None)
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
