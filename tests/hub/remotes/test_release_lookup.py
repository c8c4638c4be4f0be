"""An address without a version means the newest one there, and never a replaced one."""

from pathlib import Path

import pytest

from swarmdata.errors import ReplacedDatasetError
from swarmdata.hub.remotes.hosts.hugging_face import HubRemote
from swarmdata.hub.remotes.release_lookup import locate
from swarmdata.testing.synthetic import write_release

REPLACED, NEXT = "coop_nav-random-mini-v0", "coop_nav-random-mini-v1"
ADDRESS = "hf://org/coop_nav-random-mini"

pytestmark = pytest.mark.filterwarnings("ignore:Use 'content=:DeprecationWarning")  # the client's


def test_a_replaced_version_is_served_to_those_who_name_it(
    remote: HubRemote, tmp_path: Path
) -> None:
    """Row 72: by its tag or commit; without one, even if there is no newer version."""
    published = remote.publish(write_release(tmp_path / REPLACED, [30, 70], REPLACED), REPLACED)
    commit = published.address.rpartition("@")[2]
    for revision in ("v0", commit):
        assert locate(f"{ADDRESS}@{revision}")[1] == published
    with pytest.raises(ReplacedDatasetError, match=f"{REPLACED} was replaced by {NEXT}"):
        locate(ADDRESS)
    newer = remote.publish(write_release(tmp_path / NEXT, [31, 70], NEXT), NEXT)
    assert locate(ADDRESS)[1] == newer
