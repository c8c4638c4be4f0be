"""The gate names every reason against publishing, and lets through what is in order."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from swarmdata import gate
from swarmdata.behavior_policies.tiers import SPECS, shipped_recipes
from swarmdata.cards.render import write_card
from swarmdata.cards.schema import Interval, published, references_of
from swarmdata.gate import reasons_against
from swarmdata.remotes import push
from swarmdata.remotes.folders import FolderRemote
from swarmdata.store import open_store


@pytest.fixture(scope="module")
def good(record: Callable[..., Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("gate") / "good"
    spec = SPECS["coop_nav"].with_updates(horizon=50)
    record(folder, spec, ("random",))
    write_card(folder)
    return folder


@pytest.fixture
def remote(tmp_path: Path) -> FolderRemote:
    (tmp_path / "remote").mkdir()
    return FolderRemote(f"file://{tmp_path}/remote")


def test_what_is_in_order_passes_and_passes_again(good: Path, remote: FolderRemote) -> None:
    def check(folder: Path) -> tuple[str, ...]:
        return reasons_against(folder, remote)

    release = push(good, remote, check)
    assert push(good, remote, check) == release


def test_damage_is_the_only_reason_that_counts(
    good: Path, remote: FolderRemote, tmp_path: Path
) -> None:
    broken = Path(shutil.copytree(good, tmp_path / "broken"))
    file = next(broken.glob("data.zarr/states/c.*"))
    file.write_bytes(file.read_bytes()[:-1] + b"x")
    (broken / "card.md").unlink()
    (reason,) = reasons_against(broken, remote)
    assert str(file) in reason


def test_cards(good: Path, remote: FolderRemote, tmp_path: Path) -> None:
    copy = Path(shutil.copytree(good, tmp_path / "copy"))
    (copy / "card.md").write_text((copy / "card.md").read_text().replace("1", "2"))
    (reason,) = reasons_against(copy, remote)
    assert "is not what the files say" in reason
    assert "swarmdata card" in reason
    (copy / "card.md").unlink()
    (reason,) = reasons_against(copy, remote)
    assert "it has no card.md" in reason


def test_a_version_that_is_taken(
    good: Path, remote: FolderRemote, record: Callable[..., Path], tmp_path: Path
) -> None:
    another = record(tmp_path / "another", SPECS["coop_nav"].with_updates(horizon=60), ("random",))
    write_card(another)
    push(good, remote, lambda folder: ())
    (reason,) = reasons_against(another, remote)
    assert "a published version never changes" in reason


def test_an_id_of_the_package_is_one_dataset(good: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stored = open_store(good)
    key = stored.recipe.id
    shipped = next(iter(shipped_recipes().values()))
    with monkeypatch.context() as patch:
        patch.setattr(gate, "shipped_recipes", lambda: {key: shipped})
        (reason,) = gate._of_identity(stored)
        assert "made from another" in reason
    monkeypatch.setattr(gate, "published", lambda: {key: next(iter(published().values()))})
    (reason,) = gate._of_identity(stored)
    assert "was published with" in reason


@pytest.mark.parametrize(
    ("tier", "wrong", "n_reasons"),
    [
        ("medium", "medium", 1),
        ("medium", "expert", 0),
        ("expert", "expert", 1),
        ("medium-expert", "medium", 1),
        ("random", "medium", 0),
    ],
)
def test_tiers_keep_their_bands(
    good: Path, monkeypatch: pytest.MonkeyPatch, tier: str, wrong: str, n_reasons: int
) -> None:
    stored = open_store(good)
    recipe = shipped_recipes()[f"coop_nav-{tier}-mini-v0"]
    object.__setattr__(stored, "recipe", recipe)
    assert gate._of_tier(stored) == ()

    known = references_of(recipe.spec.hash())
    assert known is not None
    low = {**known.policies[wrong], "success": Interval(value=0.1, low=0.1, high=0.1)}
    worse = known.model_copy(update={"policies": {**known.policies, wrong: low}})
    monkeypatch.setattr(gate, "references_of", lambda spec_hash: worse)
    assert len(gate._of_tier(stored)) == n_reasons
