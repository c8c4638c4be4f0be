"""The on-disk format: parts, assembly into a dataset's folder, and checked memory maps of it.

Nothing here imports zarr to read; zarr-python writes the metadata, so that `zarr.open` reads the
same bits.
"""

from swarmdata.runtime.atomic import remove_leftovers, write_file
from swarmdata.store.assembly import assemble, write_dataset
from swarmdata.store.episode_order import MergeOrder, merge_order
from swarmdata.store.episode_selection import Piece, Selection
from swarmdata.store.integrity.damage import Damage, find_damage
from swarmdata.store.manifest import Manifest, read_manifest
from swarmdata.store.parts import check_episode, read_part_table, write_part
from swarmdata.store.split_rule import assign_splits
from swarmdata.store.stored_dataset import StoredDataset, open_store
from swarmdata.store.table import SPLITS, EpisodeTable, PartTable

__all__ = [
    "SPLITS",
    "Damage",
    "EpisodeTable",
    "Manifest",
    "MergeOrder",
    "PartTable",
    "Piece",
    "Selection",
    "StoredDataset",
    "assemble",
    "assign_splits",
    "check_episode",
    "find_damage",
    "merge_order",
    "open_store",
    "read_manifest",
    "read_part_table",
    "remove_leftovers",
    "write_dataset",
    "write_file",
    "write_part",
]
