"""Remotes: where datasets come from and go to, behind one small interface.

A remote finds a dataset by its exact id, gives single files and takes whole datasets. What this
side checks, resumes and renames is the same for all of them: `pull_dataset` and `release_files`.
"""

from swarmdata.hub.remotes.addresses import Address, configured_remotes, open_remote, parse_address
from swarmdata.hub.remotes.interface import Release, Remote
from swarmdata.hub.remotes.pull_dataset import fetch_file, pull
from swarmdata.hub.remotes.release_files import push
from swarmdata.hub.remotes.release_lookup import find_release, locate

__all__ = [
    "Address",
    "Release",
    "Remote",
    "configured_remotes",
    "fetch_file",
    "find_release",
    "locate",
    "open_remote",
    "parse_address",
    "pull",
    "push",
]
