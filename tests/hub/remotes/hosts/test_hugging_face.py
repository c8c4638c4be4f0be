"""The true huggingface_hub client against a hub on this machine."""

from pathlib import Path

import pytest

from swarmdata.errors import AbsentFileError, HubError
from swarmdata.hub.remotes.hosts.hugging_face import HubRemote
from swarmdata.hub.remotes.interface import Release
from swarmdata.hub.remotes.pull_dataset import pull
from swarmdata.hub.remotes.release_lookup import find_release, locate
from swarmdata.testing.synthetic import RELEASE_CARD
from tests.hub.remotes.conftest import ID, NAME, NEXT, TOKEN, is_pulled
from tests.hub.remotes.faults import Fault
from tests.hub.remotes.loopback_hub import LoopbackHub
from tests.support.pairs import slow

pytestmark = pytest.mark.filterwarnings("ignore:Use 'content=:DeprecationWarning")  # the client's


def test_a_push_is_one_commit_and_a_tag(
    remote: HubRemote, hub: LoopbackHub, dataset: Path, beside: Path
) -> None:
    release = remote.publish(dataset, ID, beside)

    repository = hub.repositories[NAME]
    assert repository.titles == ["initial commit", ID]
    assert repository.tags == {"v0": repository.branches["main"]}
    assert release == Release(ID, f"hf://org/coop_nav-synthetic@{repository.tags['v0']}")
    assert repository.main["card.md"].data == RELEASE_CARD.encode()
    assert {"README.md", "more/table.parquet"} <= repository.main.keys()
    assert any(blob.sha256 for blob in repository.main.values())
    assert remote.ids() == (ID,)


@pytest.mark.slow
def test_a_next_version_replaces_the_data_and_nothing_else(
    remote: HubRemote, hub: LoopbackHub, dataset: Path, successor: Path, beside: Path
) -> None:
    first = remote.publish(dataset, ID, beside)
    repository = hub.repositories[NAME]
    old = repository.main["recipe.json"]
    repository.commit({**repository.main, "LICENSE": old, "data.zarr/stale": old}, "by hand")

    second = remote.publish(successor, NEXT, beside)

    assert "LICENSE" in repository.main
    assert "data.zarr/stale" not in repository.main
    assert remote.ids() == (ID, second.id)
    assert remote.at("coop_nav-synthetic") == second
    assert remote.at("coop_nav-synthetic", "v0") == first
    commit = first.address.rpartition("@")[2]
    assert remote.at("coop_nav-synthetic", commit) == first
    assert remote.at("coop_nav-synthetic", "v7") is None
    assert remote.at("coop_nav-nothing") is None


def test_reads_are_pinned(
    remote: HubRemote, hub: LoopbackHub, dataset: Path, tmp_path: Path
) -> None:
    release = remote.publish(dataset, ID)
    repository = hub.repositories[NAME]
    repository.tags["v0"] = repository.commit({}, "the tag was moved")

    remote.read(release, "recipe.json", tmp_path / "out", 1 << 20)
    assert (tmp_path / "out").read_bytes() == (dataset / "recipe.json").read_bytes()
    with pytest.raises(AbsentFileError, match=r"has no file 'card\.txt'"):
        remote.read(release, "card.txt", tmp_path / "x", 10)
    with pytest.raises(HubError, match="not pinned"):
        remote.read(Release(ID, "hf://org/coop_nav-synthetic@v0"), "x", tmp_path / "x", 1)
    hub.repositories["org/Copy"] = repository
    with pytest.raises(HubError, match=f"org/Copy@.* holds {ID}, expected a repository of the"):
        remote.at("Copy", release.address.rpartition("@")[2])
    nowhere = Release(ID, f"hf://org/coop_nav-synthetic@{'0' * 40}")
    with pytest.raises(AbsentFileError, match="no commit"):
        remote.read(nowhere, "recipe.json", tmp_path / "x", 10)


def test_finding_is_one_request(remote: HubRemote, hub: LoopbackHub, dataset: Path) -> None:
    """`find` is one request; what it has seen is not asked for again."""
    remote.publish(dataset, ID)
    hub.log.clear()
    fresh = HubRemote("hf://org")
    assert fresh.find(ID) is not None
    asked = [line.lower() for line in hub.log if "agent-harnesses" not in line]
    assert asked == ["get /api/datasets/org/coop_nav-synthetic/revision/v0?blobs=true"]


@pytest.mark.parametrize("variable", ["HF_HUB_OFFLINE", "SWARMDATA_OFFLINE"])
def test_offline_asks_nothing(
    remote: HubRemote, hub: LoopbackHub, monkeypatch: pytest.MonkeyPatch, variable: str
) -> None:
    monkeypatch.setenv(variable, "1")
    with pytest.raises(HubError, match=f"because {variable} is set"):
        remote.find(ID)
    assert hub.log == []


def test_what_is_absent_may_be_private(remote: HubRemote) -> None:
    with pytest.raises(HubError, match=r"private dataset.*hf auth login"):
        locate("hf://org/coop_nav-synthetic@v0")
    with pytest.raises(HubError, match=r"private dataset.*hf auth login"):
        find_release(ID, ["hf://org"])


@pytest.mark.parametrize("status", [401, *slow(403)])
def test_refusals_say_what_to_do_and_hide_the_token(
    remote: HubRemote, hub: LoopbackHub, dataset: Path, successor: Path, status: int
) -> None:
    remote.publish(dataset, ID)
    hub.faults.append(Fault("POST .*/commit/", status, {"X-Error-Message": f"bad {TOKEN}"}))
    with pytest.raises(HubError, match="hf auth login") as caught:
        remote.publish(successor, NEXT)
    assert TOKEN not in str(caught.value)


@pytest.mark.slow
def test_real_xet(
    hub: LoopbackHub,
    remote: HubRemote,
    dataset: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The client chunks, sends and fetches through its own storage protocol, against a folder."""
    monkeypatch.setattr("huggingface_hub.constants.HF_HUB_DISABLE_XET", False)
    hub.cas = tmp_path / "cas"
    hub.cas.mkdir()
    release = remote.publish(dataset, ID)
    assert hub.lfs == {}
    assert any("xet-write-token" in line for line in hub.log)
    for path in filter(Path.is_file, dataset.rglob("*")):
        hub.register_xet(path)

    hub.log.clear()
    assert is_pulled(pull(remote, release, tmp_path / ID, progress=False), dataset)
    assert any("xet-read-token" in line for line in hub.log)
    assert not any("_lfs" in line for line in hub.log)
