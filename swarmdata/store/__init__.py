"""The on-disk format, without zarr: parts, assembly into a dataset, and checked memory maps of it.

Only what readers need is named here.
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
