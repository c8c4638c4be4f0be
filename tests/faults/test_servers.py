"""What remotes and the network do to a dataset on its way: nothing lost, nothing half visible."""

import socket
from collections.abc import Callable
from pathlib import Path

import pytest

from swarmdata.errors import AddressError, ChecksumError, ConflictError, HubError, VersionTakenError
from swarmdata.hub.remotes.hosts.hugging_face import HubRemote
from swarmdata.hub.remotes.hosts.web import WebRemote
from swarmdata.hub.remotes.interface import Release, Remote
from swarmdata.hub.remotes.network.backoff import Backoff
from swarmdata.hub.remotes.network.pace import Pace
from swarmdata.hub.remotes.pull_dataset import pull
from swarmdata.hub.remotes.release_lookup import locate
from swarmdata.store import read_manifest
from swarmdata.store.scratch import scratch_folder
from tests.hub.remotes.conftest import ARRAY, ID, NAME, NEXT, is_pulled
from tests.hub.remotes.faults import Fault, FaultyServer
from tests.hub.remotes.loopback_hub import LoopbackHub, Repository
from tests.hub.remotes.static_host import StaticHost
from tests.support.pairs import slow

pytestmark = pytest.mark.filterwarnings("ignore:Use 'content=:DeprecationWarning")  # the client's

Served = tuple[FaultyServer, Remote, Release]


@pytest.fixture
def on_a_hub(hub: LoopbackHub, remote: HubRemote, dataset: Path, beside: Path) -> Served:
    release = remote.publish(dataset, ID, beside)
    hub.log.clear()
    return hub, remote, release


@pytest.fixture
def on_a_host(host: StaticHost, backoff: Backoff) -> Served:
    remote = WebRemote(host.url, backoff=backoff, pace=Pace(10.0, 100.0, 10.0))
    return host, remote, Release(ID, f"{host.url}/{ID}")


@pytest.fixture(params=[pytest.param("on_a_hub", marks=pytest.mark.slow), "on_a_host"])
def served(request: pytest.FixtureRequest) -> Served:
    found: Served = request.getfixturevalue(request.param)
    return found


def pattern(server: FaultyServer, file: str) -> str:
    """Matches the request that has the file's bytes as its answer."""
    if isinstance(server, LoopbackHub):
        blob = server.repositories[NAME].main[file]
        return f"GET /_lfs/{blob.sha256}" if blob.sha256 else f"GET .*/resolve/.*/{file}"
    return f"GET .*{file}"


def test_listing_with_hostile_names(on_a_hub: Served, hub: LoopbackHub, tmp_path: Path) -> None:
    """Row 17: a listing with a name that leads out, or that is there twice, is refused whole."""
    hostile = ("../../.bashrc", "/etc/cron.d/x", "C:\\x", "a\\..\\b", "CARD.MD", "recipe.json")
    for name in hostile:
        hub.extra_names = [name]
        fresh = HubRemote("hf://org", backoff=Backoff(attempts=1))
        with pytest.raises(HubError, match="Nothing of it is used"):
            fresh.find(ID)
        with pytest.raises(HubError, match="Nothing of it is used"):
            pull(fresh, on_a_hub[2], tmp_path / ID, progress=False)
        assert not (tmp_path / ID).exists()


@pytest.mark.parametrize(
    "text",
    [
        "hf://org/../x",
        "hf://or g/x",
        "hf://org/ü",
        f"hf://{'o' * 300}/x",
        "file:///a/../b",
        "hf://",
    ],
)
def test_strange_addresses(hub: LoopbackHub, text: str) -> None:
    """Row 21: strange names in addresses are refused before anything is asked."""
    with pytest.raises(AddressError):
        locate(text)
    assert hub.log == []


@pytest.mark.parametrize("name", ["../x-y-v0", "A-B-v0", "ü-x-v0", "x" * 300, "a-b-v0\n", "CON"])
def test_strange_ids(served: Served, name: str) -> None:
    """Row 21: so are strange ids, by every remote."""
    server, remote, _ = served
    server.log.clear()
    with pytest.raises(AddressError, match="is not the id of a dataset"):
        remote.find(name)
    assert server.log == []


def test_the_nearest_dataset_is_suggested(on_a_hub: Served) -> None:
    """Row 21: what is not there is answered with what is near."""
    with pytest.raises(HubError, match="Did you mean 'coop_nav-synthetic'"):
        locate("hf://org/coop_nav-sinthetic")


@pytest.mark.parametrize(
    "make",
    [
        lambda at: Fault(at, 503, times=1),
        pytest.param(lambda at: Fault(at, 500, times=1), marks=pytest.mark.slow),
        lambda at: Fault(at, 429, {"Retry-After": "0"}, times=1),
        *slow(lambda at: Fault(at, cut=700, times=1)),
        pytest.param(lambda at: Fault(at, cut=0, times=1), marks=pytest.mark.slow),
        lambda at: Fault(at, lose=True, times=1),
        lambda at: Fault(at, drip=500, pause=0.02, times=1),
    ],
    ids=["503", "500", "429", "cut", "cut at once", "hang up", "slow drip"],
)
def test_faults_that_pass(
    served: Served, dataset: Path, tmp_path: Path, make: Callable[[str], Fault]
) -> None:
    """Row 22: a fault that passes costs time and nothing else."""
    server, remote, release = served
    server.faults = [make(pattern(server, "manifest.json")), make(pattern(server, ARRAY))]
    assert is_pulled(pull(remote, release, tmp_path / ID, progress=False), dataset)
    assert all(fault.times == 0 for fault in server.faults)


@pytest.mark.parametrize("fault", [{"status": 503}, {"lose": True}], ids=["503", "hang up"])
def test_faults_that_stay(
    served: Served,
    dataset: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    fault: dict[str, int],
) -> None:
    """Row 22: a fault that stays is one error that says what still works; then a pull goes on."""
    server, remote, release = served
    files = read_manifest(dataset).files
    monkeypatch.setattr("swarmdata.hub.remotes.pull_dataset.N_WORKERS", 1)  # large files come first
    arrived, faulty, *_ = sorted(files, key=lambda name: -files[name].size)
    server.faults = [Fault(pattern(server, faulty), **fault)]  # type: ignore[arg-type]
    with pytest.raises(HubError, match="Datasets in the cache still load"):
        pull(remote, release, tmp_path / ID, progress=False)
    assert not (tmp_path / ID).exists()
    assert (scratch_folder(tmp_path / ID, "pull") / arrived).exists()

    server.faults = []
    server.log.clear()
    assert is_pulled(pull(remote, release, tmp_path / ID, progress=False), dataset)
    assert not any(arrived in line for line in server.log)


def test_faults_of_asking(served: Served) -> None:
    """Row 22: a remote that does not answer is not one that has nothing."""
    server, remote, release = served
    server.faults = [Fault("v0", 503)]
    with pytest.raises(HubError, match="Datasets in the cache still load"):
        remote.find(ID)
    server.faults = [Fault("v0", 503, times=1)]
    assert remote.find(ID) == release


def test_no_such_host(hub: LoopbackHub, backoff: Backoff, monkeypatch: pytest.MonkeyPatch) -> None:
    """Row 22: a name that no server has."""

    def fail(*args: object, **options: object) -> None:
        raise socket.gaierror(-2, "Name or service not known")

    monkeypatch.setattr(socket, "getaddrinfo", fail)
    monkeypatch.setenv("HF_ENDPOINT", "http://hub.invalid")
    hidden = (
        HubRemote("hf://org", backoff=backoff),
        WebRemote("http://host.invalid", backoff=backoff),
    )
    for each in hidden:
        with pytest.raises(HubError, match="Datasets in the cache still load"):
            each.find(ID)


@pytest.mark.parametrize("file", ["manifest.json", "recipe.json", ARRAY])
def test_wrong_bytes_of_the_right_length(
    served: Served, dataset: Path, tmp_path: Path, file: str
) -> None:
    """Row 23: thrown away and fetched once more; wrong twice is an error that names the file."""
    server, remote, release = served
    server.faults = [Fault(pattern(server, file), corrupt=True)]
    with pytest.raises(ChecksumError, match="manifest" if file == "manifest.json" else file):
        pull(remote, release, tmp_path / ID, progress=False)
    assert not (tmp_path / ID).exists()

    server.faults = [Fault(pattern(server, file), corrupt=True, times=1)]
    assert is_pulled(pull(remote, release, tmp_path / ID, progress=False), dataset)
    assert server.faults[0].times == 0


def contents(repository: Repository) -> dict[str, str]:
    """What main shows, without what the hub itself puts there."""
    return {
        path: blob.sha256 or blob.oid
        for path, blob in repository.main.items()
        if path != ".gitattributes"
    }


def push_with(hub: LoopbackHub, fault: Fault, folder: Path, dataset_id: str) -> bool:
    """Pushes once, without further attempts; whether it was finished."""
    hub.faults = [fault]
    try:
        HubRemote("hf://org", backoff=Backoff(attempts=1)).publish(folder, dataset_id)
    except HubError:
        return False
    finally:
        hub.faults = []
    return True


def n_requests(hub: LoopbackHub, folder: Path, dataset_id: str) -> int:
    hub.log.clear()
    HubRemote("hf://org").publish(folder, dataset_id)
    return len([line for line in hub.log if "agent-harnesses" not in line])


@pytest.mark.slow
@pytest.mark.parametrize(
    "kind", [{"status": 400}, {"status": 500}, {"lose": True}], ids=["400", "500", "hang up"]
)
@pytest.mark.parametrize("is_update", [False, True], ids=["first version", "next version"])
def test_a_push_that_is_cut_off_at_every_request(
    dataset: Path, successor: Path, kind: dict[str, int], is_update: bool, hub: LoopbackHub
) -> None:
    """Row 24: from the k-th request on nothing works, for every k: main is the old or the new.

    Whatever it is, the same push then ends well, with the tag, in one commit.
    """
    folder, wanted = (successor, NEXT) if is_update else (dataset, ID)
    version = wanted.rpartition("-")[2]

    def begin() -> dict[str, str]:
        hub.repositories.clear()
        hub.lfs.clear()
        if is_update:
            HubRemote("hf://org").publish(dataset, ID)
        return contents(hub.repositories[NAME]) if is_update else {}

    begin()
    n = n_requests(hub, folder, wanted)
    new = contents(hub.repositories[NAME])
    n_old = n_finished = 0
    for k in range(n):
        old = begin()
        fault = Fault("^(?!.*agent-harnesses)", skip=k, **kind)  # type: ignore[arg-type]
        finished = push_with(hub, fault, folder, wanted)
        n_finished += finished
        repository = hub.repositories.get(NAME, Repository({"": {}}, [], {"main": ""}))
        assert contents(repository) in (old, new)
        assert not finished or version in repository.tags
        n_old += contents(repository) == old

        again = HubRemote("hf://org").publish(folder, wanted)

        repository = hub.repositories[NAME]
        assert contents(repository) == new
        assert repository.titles == ["initial commit", *([ID] if is_update else []), wanted]
        assert repository.tags[version] == again.address.rpartition("@")[2]
    assert n >= 8
    assert n_old >= n - 4
    assert n_finished <= 1  # the tag was made, and its answer lost


@pytest.mark.parametrize(
    ("at", "is_committed"),
    [pytest.param("preupload", 0, marks=pytest.mark.slow), ("commit", 0), ("tag", 1)],
)
def test_a_push_that_is_cut_off(
    dataset: Path, hub: LoopbackHub, at: str, is_committed: int
) -> None:
    """Row 24: main has nothing or everything; the same push then ends well."""
    assert not push_with(hub, Fault(f"POST .*/{at}/", 400), dataset, ID)
    repository = hub.repositories[NAME]
    assert repository.titles == ["initial commit", ID][: 1 + is_committed]
    assert repository.tags == {}

    release = HubRemote("hf://org").publish(dataset, ID)
    assert repository.titles == ["initial commit", ID]
    assert repository.tags == {"v0": release.address.rpartition("@")[2]}


def test_a_commit_whose_answer_is_lost_is_not_made_twice(
    hub: LoopbackHub, remote: HubRemote, dataset: Path
) -> None:
    """Row 24: a commit that was heard is recognised, though the network ended there."""
    hub.faults = [Fault("POST .*/commit/", lose=True, times=1)]
    release = remote.publish(dataset, ID)
    assert hub.repositories[NAME].titles == ["initial commit", ID]
    assert remote.find(ID) == release


def test_two_pushers(hub: LoopbackHub, remote: HubRemote, dataset: Path, successor: Path) -> None:
    """Row 25: who comes second gets a conflict, is told to pull, and has changed nothing."""
    hub.faults = [Fault("POST .*/commit/", 412, times=1)]
    with pytest.raises(ConflictError, match="Pull what is there"):
        remote.publish(dataset, ID)

    second = HubRemote("hf://org")
    answer = hub.fault_of

    def push_first(request: str) -> Fault | None:
        if "/commit/" in request:
            hub.fault_of = answer  # type: ignore[method-assign]
            remote.publish(dataset, ID)
        return answer(request)

    hub.fault_of = push_first  # type: ignore[method-assign]
    with pytest.raises(ConflictError, match="swarmdata pull hf://org/coop_nav-synthetic"):
        second.publish(successor, NEXT)
    repository = hub.repositories[NAME]
    assert repository.titles == ["initial commit", ID]
    assert set(repository.tags) == {"v0"}

    assert HubRemote("hf://org").publish(successor, NEXT).id == NEXT


@pytest.mark.parametrize("is_ours", [False, *slow(True)], ids=["another commit", "ours"])
def test_a_tag_that_somebody_else_made_meanwhile(
    hub: LoopbackHub, remote: HubRemote, dataset: Path, successor: Path, is_ours: bool
) -> None:
    """Row 25: between our commit and our tag; a version is never said to hold what it does not."""
    remote.publish(successor, NEXT)
    repository, answer = hub.repositories[NAME], hub.fault_of
    theirs = repository.tags["v1"]

    def tag_first(request: str) -> Fault | None:
        if "/tag/" in request:
            repository.tags["v0"] = list(repository.commits)[-1] if is_ours else theirs
        return answer(request)

    hub.fault_of = tag_first  # type: ignore[method-assign]
    if is_ours:
        assert remote.publish(dataset, ID).address.endswith(repository.tags["v0"])
    else:
        with pytest.raises(VersionTakenError, match="another coop_nav-synthetic-v0"):
            remote.publish(dataset, ID)
    assert (repository.tags["v0"] == theirs) is not is_ours
