"""The on-disk format: parts, assembly into a dataset's folder, and checked memory maps of it.

`zarr.open` reads the same bits; nothing here imports zarr, neither to read nor to write. Only what
readers need is named here: what writes datasets has modules of its own.
"""

from swarmdata.runtime.atomic import remove_leftovers, write_file
from swarmdata.store.manifest import Manifest, read_manifest
from swarmdata.store.stored_dataset import StoredDataset, open_store
from swarmdata.store.table import SPLITS, EpisodeTable

__all__ = [
    "SPLITS",
    "EpisodeTable",
    "Manifest",
    "StoredDataset",
    "open_store",
    "read_manifest",
    "remove_leftovers",
    "write_file",
]
