"""The gate names every reason against publishing, and lets through what is in order."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from swarmdata.cards.card import write_card
from swarmdata.hub.publishing.blockers import find_blockers
from swarmdata.hub.remotes.hosts.folders import FolderRemote
from swarmdata.hub.remotes.release_files import push
from swarmdata.registry.recipes import FAMILY_SPECS


@pytest.fixture(scope="module")
def good(record: Callable[..., Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("gate") / "good"
    spec = FAMILY_SPECS["coop_nav"].with_updates(horizon=50)
    record(folder, spec, ("random",))
    write_card(folder)
    return folder


@pytest.fixture
def remote(tmp_path: Path) -> FolderRemote:
    (tmp_path / "remote").mkdir()
    return FolderRemote(f"file://{tmp_path}/remote")


def test_what_is_in_order_passes_and_passes_again(good: Path, remote: FolderRemote) -> None:
    def check(folder: Path) -> tuple[str, ...]:
        return find_blockers(folder, remote)

    release = push(good, remote, check)
    assert push(good, remote, check) == release


def test_damage_is_the_only_reason_that_counts(
    good: Path, remote: FolderRemote, tmp_path: Path
) -> None:
    broken = Path(shutil.copytree(good, tmp_path / "broken"))
    file = next(broken.glob("data.zarr/states/c.*"))
    file.write_bytes(file.read_bytes()[:-1] + b"x")
    (broken / "card.md").unlink()
    (reason,) = find_blockers(broken, remote)
    assert str(file) in reason


def test_cards(good: Path, remote: FolderRemote, tmp_path: Path) -> None:
    copy = Path(shutil.copytree(good, tmp_path / "copy"))
    (copy / "card.md").write_text((copy / "card.md").read_text().replace("1", "2"))
    (reason,) = find_blockers(copy, remote)
    assert "of card.md is" in reason
    assert "swarmdata card" in reason
    (copy / "card.md").unlink()
    (reason,) = find_blockers(copy, remote)
    assert "there is no card.md" in reason


def test_a_version_that_is_taken(
    good: Path, remote: FolderRemote, record: Callable[..., Path], tmp_path: Path
) -> None:
    another = record(
        tmp_path / "another", FAMILY_SPECS["coop_nav"].with_updates(horizon=60), ("random",)
    )
    write_card(another)
    push(good, remote, lambda folder: ())
    (reason,) = find_blockers(another, remote)
    assert "a published version never changes" in reason
