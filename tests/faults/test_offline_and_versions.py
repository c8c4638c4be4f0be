"""Machines without a network, and files of other versions of this package and of the physics."""

import contextlib
import json
import socket
import zipfile
from collections.abc import Callable
from pathlib import Path
from unittest.mock import Mock

import pytest

import swarmdata
from swarmdata.audit import audit, replay_checks
from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import FormatVersionError, SwarmdataError
from swarmdata.hub.catalog.repair import examine
from swarmdata.registry.components import make_env
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.store.arrays.layout import FORMAT_VERSION
from swarmdata.store.damage import find_damage
from tests.support.at_once import Forked
from tests.support.namespaces import CLONE_NEWNET, enter
from tests.support.pairs import slow
from tests.support.tiny import sign

ROOT = Path(__file__).parents[2]
GOLDEN = ROOT / "tests" / "golden" / "format_1.zip"
"""A dataset of format 1 as it was first written; it is never written again."""


def print_sources(*names: str) -> None:
    """Loads datasets in a network without a way out, and counts what is asked of it."""
    with contextlib.suppress(OSError):  # where the system has none, requests are refused anyway
        enter(CLONE_NEWNET)
    refuse = Mock(side_effect=OSError("no network in this test"))
    for owner, name in ((socket.socket, "connect"), (socket, "getaddrinfo")):
        setattr(owner, name, refuse)
    for name in names:
        try:
            print(swarmdata.load(name, progress=False).source)
        except SwarmdataError as error:
            print(type(error).__name__, error)
    print(refuse.call_count, "requests")


def load_without_network(*names: str, **variables: str) -> list[str]:
    """Runs `load` where nothing can be reached."""
    remote = {"SWARMDATA_REMOTES": "hf://swarmdata-test"}
    code, out, words = Forked(*names, work=print_sources, variables=remote | variables).end()
    assert code == 0, words
    return out.splitlines()


@pytest.mark.parametrize("variable", ["SWARMDATA_OFFLINE", *slow("HF_HUB_OFFLINE")])
def test_offline_a_warm_cache_works_and_a_cold_one_says_what_to_run(
    cache_folder: Path, record: Callable[..., Path], variable: str
) -> None:
    """Row 28: without a single request, which a pinned name needs nowhere."""
    place = cache_folder / "datasets" / "coop_nav-small-v0"
    place.parent.mkdir()
    record(place, TaskSpec(horizon=20), ("random",))
    warm, also, cold, address, asked = load_without_network(
        "coop_nav-small", "coop_nav-small-v0", "lab-nowhere", "hf://lab/run@v1", **{variable: "1"}
    )
    assert (warm, also, asked) == ("cache", "cache", "0 requests")
    assert cold.startswith("UnknownNameError")
    assert "swarmdata pull lab-nowhere --from hf://" in cold
    assert address.startswith("DatasetNotFoundError")
    assert "swarmdata pull hf://lab/run@v1" in address
    assert load_without_network("coop_nav-small-v0") == ["cache", "0 requests"]


@pytest.fixture
def old(tmp_path: Path) -> Path:
    with zipfile.ZipFile(GOLDEN) as archive:
        archive.extractall(tmp_path / "old")
    return tmp_path / "old"


def test_a_dataset_of_the_first_format_is_read(old: Path) -> None:
    """Row 29: every byte and both digests, whatever has been added since."""
    dataset = Dataset.open(old, "full")
    assert dataset.digest == "82e55ab1d6ee776ac08e6ab8e8631b783cb20c638668f376c18685144c9772db"
    assert (dataset.id, dataset.n_steps, len(dataset)) == ("coop_nav-tiny-v0", 80, 2)
    assert find_damage(old) == ()


def test_a_newer_format_says_upgrade_and_is_no_damage(old: Path) -> None:
    """Row 29: nothing is repaired that is only newer."""
    manifest = json.loads((old / "manifest.json").read_bytes())
    sign(old, {**manifest, "format_version": FORMAT_VERSION + 1, "arrays": {"a": "new form"}})
    for work in (Dataset.open, examine):
        with pytest.raises(FormatVersionError, match="pip install --upgrade swarmdata"):
            work(old)


def test_a_world_that_has_drifted_shows_in_a_replay(
    tmp_path: Path, record: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Row 30: a physics step that is different in the last bit, and the version that has it."""
    folder = record(tmp_path / "d", TaskSpec(horizon=20), ("straight",))
    assert audit(folder, sample=3, only=("replay",)).findings == ()
    changed = Dataset.open(folder).task.with_updates(physics_dt=0.025)
    monkeypatch.setattr(replay_checks, "make_env", lambda spec, n: make_env(changed, n))
    monkeypatch.setattr(replay_checks, "made_with", lambda backend: {"pymunk": "9.9"})
    (found,) = audit(folder, sample=3, only=("replay",)).problems
    assert "3 of 3 replayed episodes differ from the stored ones: episode" in found.message
    assert "other versions: pymunk 9.9 instead of" in found.message
