"""RemoteArrays: rows of a published dataset's arrays, fetched chunk by chunk, each checked."""

from dataclasses import dataclass
from typing import Any, cast

import numpy as np
import xxhash
from numpy.typing import NDArray

from swarmdata.errors import ChecksumError, HubError
from swarmdata.hub.remotes.addresses import open_remote
from swarmdata.hub.remotes.interface import RangeReader, Release, Remote
from swarmdata.hub.streaming.chunk_cache import ChunkCache
from swarmdata.store import Manifest


@dataclass(frozen=True, eq=False)
class RemoteArrays:
    """The arrays of one release; may be used from several threads.

    The manifest lists the xxh3_64 of every chunk, by which each is checked when it arrives and when
    it is read again from the cache.
    """

    remote: RangeReader  # where from
    release: Release  # of the dataset
    manifest: Manifest  # of the dataset, checked
    cache: ChunkCache  # of chunks that were fetched before

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickles the remote's address: connections belong to one process."""
        remote = cast("Remote", self.remote)  # one that reads ranges as well
        return _reopened, (remote.address, self.release, self.manifest, self.cache)

    def dtype(self, name: str) -> np.dtype[Any]:
        return np.dtype(self.manifest.plan[name].shard.dtype)

    def rows(self, name: str, first: int, last: int) -> NDArray[Any]:
        """Returns the rows of an array from `first` to before `last`, in memory."""
        shard = self.manifest.plan[name].shard
        rows = np.empty((last - first, *shard.shape[1:]), dtype=shard.dtype)
        if not rows.size:
            return rows
        for index in range(first // shard.chunk_rows, -(-last // shard.chunk_rows)):
            begin = index * shard.chunk_rows
            low, high = max(first, begin), min(last, begin + shard.chunk_rows)
            chunk = np.frombuffer(self.chunk(name, index), dtype=shard.dtype)
            values = chunk.reshape(shard.chunk_rows, *shard.shape[1:])
            rows[low - first : high - first] = values[low - begin : high - begin]
        return rows

    def chunk(self, name: str, index: int) -> bytes:
        """Returns the bytes of one chunk, from the cache or the remote; both are checked."""
        key = f"{self.manifest.transport_digest[:32]}/{name}/{index}"
        checksum = self.manifest.arrays[name].checksums[index]
        content = self.cache.read(key)
        if content is not None and xxhash.xxh3_64_hexdigest(content) == checksum:
            return content
        if content is not None:
            self.cache.forget(key)
        content = self._fetched(name, index, checksum)
        self.cache.write(key, content)
        return content

    def _fetched(self, name: str, index: int, checksum: str) -> bytes:
        plan = self.manifest.plan[name]
        shard = plan.shard
        file = plan.files[index // shard.shard_chunks]
        begin = index % shard.shard_chunks * shard.chunk_bytes
        first, last = shard.rows_of(index)
        what = f"chunk {index} of {file} (rows {first} to {last} of {name!r})"
        for _ in range(2):
            try:
                content = self.remote.read_range(self.release, file, begin, shard.chunk_bytes)
            except HubError as error:
                raise HubError(
                    f"{self.release.id} was being streamed, and {what} could not be fetched from "
                    f"{self.release.address}: {error} What has arrived is kept in the cache; run "
                    "again to go on, or load the dataset without stream=True."
                ) from error
            if xxhash.xxh3_64_hexdigest(content) == checksum:
                return content
        raise ChecksumError(
            f"{self.release.address} gave wrong bytes of {what} twice: they do not have the "
            "checksum in the manifest. They were thrown away; stream from another remote, and tell "
            "whoever publishes there."
        )


def _reopened(address: str, *parts: Any) -> RemoteArrays:
    remote = open_remote(address)
    assert isinstance(remote, RangeReader)  # as it was there
    return RemoteArrays(remote, *parts)
