"""Remotes: where datasets come from and go to, behind one small interface.

A remote finds a dataset by its exact id, gives single files and takes whole datasets. What is
checked, resumed and renamed on this side is the same for all of them: `pulling` and `pushing`.
"""

from swarmdata.remotes.addresses import Address, configured_remotes, open_remote, parse_address
from swarmdata.remotes.interface import Release, Remote
from swarmdata.remotes.locating import find_release, locate
from swarmdata.remotes.pulling import fetch_file, pull
from swarmdata.remotes.pushing import push

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
