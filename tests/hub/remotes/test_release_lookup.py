"""An address without a version means the newest one there, and never a replaced one."""

from pathlib import Path

import pytest

from swarmdata.hub.remotes.hosts.hugging_face import HubRemote
from swarmdata.hub.remotes.release_lookup import locate
from swarmdata.testing.synthetic import write_release

OLDER, NEXT = "coop_nav-random-mini-v0", "coop_nav-random-mini-v1"
ADDRESS = "hf://org/coop_nav-random-mini"

pytestmark = pytest.mark.filterwarnings("ignore:Use 'content=:DeprecationWarning")  # the client's


def test_an_older_version_is_served_to_those_who_name_it(remote: HubRemote, tmp_path: Path) -> None:
    """By its tag or commit; without one, the newest is."""
    published = remote.publish(write_release(tmp_path / OLDER, [30, 70], OLDER), OLDER)
    commit = published.address.rpartition("@")[2]
    for revision in ("v0", commit):
        assert locate(f"{ADDRESS}@{revision}")[1] == published
    assert locate(ADDRESS)[1] == published
    newer = remote.publish(write_release(tmp_path / NEXT, [31, 70], NEXT), NEXT)
    assert locate(ADDRESS)[1] == newer
