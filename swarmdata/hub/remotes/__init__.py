"""Remotes: where datasets come from and go to, behind one small interface.

A remote finds a dataset by its exact id, gives single files and takes whole datasets. What is
checked, resumed and renamed on this side is the same for all of them: `pulling` and `pushing`.
"""

from swarmdata.hub.remotes.addresses import Address, configured_remotes, open_remote, parse_address
from swarmdata.hub.remotes.interface import Release, Remote
from swarmdata.hub.remotes.locate import find_release, locate
from swarmdata.hub.remotes.pull import fetch_file, pull
from swarmdata.hub.remotes.push import push

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
