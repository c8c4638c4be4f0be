"""From a request to a streamed dataset: on this machine, or on the first remote that has it."""

import warnings
from dataclasses import replace
from pathlib import Path

from swarmdata.errors import AbsentFileError, HubError, check_type
from swarmdata.hub.catalog.catalog import AnotherDatasetWarning, references_for
from swarmdata.hub.catalog.identity import judge
from swarmdata.hub.catalog.request import Request, cached, parse_request
from swarmdata.hub.catalog.sources import Remotes, refusal
from swarmdata.hub.remotes.hosts.folders import FolderRemote
from swarmdata.hub.remotes.interface import Release
from swarmdata.hub.streaming.streamed_dataset import Stream, StreamedDataset, open_stream
from swarmdata.specs.model_choice import Source
from swarmdata.store import read_manifest


class DatasetFolder(FolderRemote):
    """The folder of one dataset, whatever its name is, as a remote."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder.resolve().parent.as_uri())
        self._folder = folder.resolve()

    def _source(self, release: Release, file: str) -> Path:
        path = self._folder / file
        if not path.is_file() or path.is_symlink():
            raise AbsentFileError(f"{self._folder} has no file {file!r}.")
        return path


def open_streamed(
    dataset_id: str | Path,
    *,
    stream: Stream | None,
    is_offline: bool,
    observation: Source | None,
    communication: Source | None,
    progress: bool,
) -> StreamedDataset:
    """Opens one dataset without fetching it, as `load` does; `stream` None is the default."""
    check_type("stream", stream or Stream(), Stream, "True or a Stream")
    remotes = Remotes(offline=is_offline, progress=progress)
    dataset = stream_request(parse_request(dataset_id), remotes, stream or Stream())
    identity = judge(dataset.blocks.source.manifest)
    if not identity.is_as_named:  # on this machine: of remotes, such are refused
        warnings.warn(
            f"{dataset.source}: {identity.sentence}.", AnotherDatasetWarning, stacklevel=3
        )
    blocks = dataset.blocks
    references = references_for(
        blocks.recipe, blocks.manifest.arrays, lambda name: blocks.read(0, (name,))[name]
    )
    dataset = replace(dataset, references=references)
    if observation is None and communication is None:
        return dataset
    return dataset.reobserve(observation, communication)


def stream_request(request: Request, remotes: Remotes, stream: Stream) -> StreamedDataset:
    """Opens a dataset for streaming; one on this machine is read from its folder, uncached."""
    found = cached(request)
    if found is None:
        request = remotes.pin(request)
        found = cached(request)
    if found is not None:
        manifest = read_manifest(found.folder)
        release = Release(manifest.id, str(found.folder))
        local = Stream(stream.window, 0, stream.seed)
        return open_stream(DatasetFolder(found.folder), release, local, lambda manifest: None)
    refuse = refusal(request.recipe)
    if request.release is not None:
        return open_stream(*request.release, stream, refuse)
    name = request.text if request.folder is None else request.folder.name
    opened = remotes.first(
        name, lambda remote, release: open_stream(remote, release, stream, refuse)
    )
    if opened is not None:
        return opened
    asked = ", ".join(remotes.asked) or "none"
    raise HubError(
        f"{name} cannot be streamed: it is not on this machine, and no remote has it (asked: "
        f"{asked}). Give its address, such as hf://ORGANIZATION/{name}, or load it without "
        "stream=True."
    )
