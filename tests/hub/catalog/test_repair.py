"""All damage is named, and a repair replaces what is broken and nothing else."""

import json
import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import HealthCheck, assume, example, given, settings
from hypothesis import strategies as st

from swarmdata.errors import DatasetError, ManifestError
from swarmdata.hub.catalog import repair as repair_module
from swarmdata.hub.catalog.repair import Repair, examine, repair
from swarmdata.hub.catalog.sources import RemoteSkippedWarning
from swarmdata.hub.remotes.interface import Remote
from swarmdata.registry.published import Published
from swarmdata.store import read_manifest
from swarmdata.store.damage import find_damage
from tests.support.one_process import OneProcessCrew, use_one_process
from tests.support.pairs import slow
from tests.support.tiny import TINY, Shelf, contents, flip, make_tiny, sign

STATES, ACTIONS = "data.zarr/states/c.0.0", "data.zarr/actions/c.0.0.0"
META = "data.zarr/rewards/zarr.json"
FILES = [STATES, ACTIONS, META, "data.zarr/zarr.json", "recipe.json", "card.md"]


@pytest.fixture(scope="module", autouse=True)
def crew() -> Iterator[type[OneProcessCrew]]:
    """Everything is built in this process, and counted."""
    with pytest.MonkeyPatch.context() as patch:
        use_one_process(patch)
        yield OneProcessCrew


def offer(monkeypatch: pytest.MonkeyPatch, *shelves: Shelf) -> tuple[str, ...]:
    known: dict[str, Remote] = {shelf.address: shelf for shelf in shelves}
    monkeypatch.setattr(repair_module, "open_remote", known.__getitem__)
    return tuple(known)


def test_an_intact_dataset_has_no_damage_and_is_not_touched(dataset: Path) -> None:
    before = {path: path.stat().st_mtime_ns for path in dataset.rglob("*")}
    assert examine(dataset) == ()
    assert repair(dataset) == ()
    assert {path: path.stat().st_mtime_ns for path in dataset.rglob("*")} == before
    assert {path.name for path in dataset.parent.iterdir()} == {TINY.id}


def test_every_broken_file_is_named_with_its_first_bad_chunk(dataset: Path) -> None:
    entry = read_manifest(dataset).arrays["states"]
    flip(dataset / STATES, 40)
    flip(dataset / META, 7)
    (dataset / "data.zarr/events/c.0.0.0").unlink()
    os.truncate(dataset / ACTIONS, 100)
    flip(dataset / "data.zarr/rewards/c.0.0", -1)
    found = {each.file: each for each in examine(dataset)}

    assert list(found) == sorted(found)
    assert set(found) == {
        STATES, ACTIONS, META, "data.zarr/events/c.0.0.0", "data.zarr/rewards/c.0.0",
    }  # fmt: skip
    assert (found[STATES].array, found[STATES].chunk) == ("states", 0)
    assert found[STATES].rows == (0, entry.shape[0] - 1)
    assert f"rows 0 to {entry.shape[0] - 1} of 'states'" in str(found[STATES])
    assert "has 100 bytes, expected" in found[ACTIONS].problem
    assert found["data.zarr/events/c.0.0.0"].problem == "is absent"
    assert "shard index" in found["data.zarr/rewards/c.0.0"].problem
    assert "SHA-256" in found[META].problem


def test_the_first_bad_chunk_of_many_is_named(tmp_path: Path) -> None:
    from swarmdata.testing.synthetic import make_dataset

    path = tmp_path / "d"
    make_dataset(path, [[2500] * 10], n_steps=25_000)
    entry = read_manifest(path).arrays["rewards"]
    assert entry.shard.n_chunks == 3
    flip(path / "data.zarr/rewards/c.0.0", entry.shard.chunk_bytes + 5)
    flip(path / "data.zarr/rewards/c.0.0", 2 * entry.shard.chunk_bytes + 5)
    (damage,) = find_damage(path)

    assert (damage.chunk, damage.rows) == (1, (entry.chunk_rows, 2 * entry.chunk_rows - 1))
    assert "2 of 3 chunks are bad" in damage.problem
    os.truncate(path / "data.zarr/rewards/c.0.0", 10)
    (damage,) = find_damage(path)
    assert damage.chunk == 0


@pytest.mark.parametrize("change", ["absent", "other", *slow("cut")])
def test_a_damaged_card_shows_and_is_written_anew(dataset: Path, change: str) -> None:
    card = dataset / "card.md"
    text = card.read_text()
    if change == "absent":
        card.unlink()
    else:
        card.write_text(text.replace("random", "expert") if change == "other" else text[:-40])
    (damage,) = examine(dataset)
    assert damage.file == "card.md"
    assert "absent" in damage.problem or "line " in damage.problem
    assert repair(dataset) == (Repair("card.md", "written anew"),)
    assert card.read_text() == text


def test_a_signed_contradiction_is_damage_of_the_manifest(dataset: Path) -> None:
    manifest = json.loads((dataset / "manifest.json").read_bytes())
    sign(dataset, {**manifest, "digest": "0" * 64})
    (damage,) = examine(dataset)
    assert (damage.file, "logical digest" in damage.problem) == ("manifest.json", True)


def test_a_link_is_named_not_followed_and_replaced(dataset: Path, tmp_path: Path) -> None:
    before = contents(dataset)
    shutil.move(dataset / "data.zarr" / "states", tmp_path / "elsewhere")
    (dataset / "data.zarr" / "states").symlink_to(tmp_path / "elsewhere")
    assert [each.file for each in examine(dataset)] == ["data.zarr/states"]
    repair(dataset, progress=False)
    assert contents(dataset) == before
    assert (tmp_path / "elsewhere" / "c.0.0").exists()


def test_only_what_is_broken_is_made_again(dataset: Path) -> None:
    before, whole = contents(dataset), (dataset / ACTIONS).stat().st_ino
    flip(dataset / STATES, 40)
    (dataset / META).unlink()
    done = repair(dataset, progress=False)

    assert done == tuple(Repair(file, "made again from the recipe") for file in (META, STATES))
    assert contents(dataset) == before
    assert (dataset / ACTIONS).stat().st_ino == whole, "an intact file is left as it is"
    assert {path.name for path in dataset.parent.iterdir()} == {TINY.id}


def test_a_remote_is_asked_before_anything_is_built(
    dataset: Path, tiny: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = contents(dataset)
    other = make_tiny(tmp_path / "other", seed=9)
    wrong, broken = Shelf(tmp_path / "1", other), Shelf(tmp_path / "2", tiny, fails=True)
    empty, right = Shelf(tmp_path / "3"), Shelf(tmp_path / "4", tiny)
    flip(dataset / STATES, 40)
    made = len(OneProcessCrew.made)
    with pytest.warns(RemoteSkippedWarning) as caught:
        done = repair(dataset, remotes=offer(monkeypatch, wrong, broken, empty, right))

    assert done == (Repair(STATES, f"fetched from {right.address}"),)
    messages = [str(warning.message) for warning in caught]
    assert [
        shelf.address in text for shelf, text in zip((wrong, broken, empty), messages, strict=True)
    ] == [True] * 3
    assert contents(dataset) == before
    assert len(OneProcessCrew.made) == made


def test_what_a_remote_lacks_is_built(
    dataset: Path, tiny: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before, shelf = contents(dataset), Shelf(tmp_path / "1", tiny)
    flip(tmp_path / "1" / TINY.id / STATES, 41)
    flip(dataset / STATES, 40)
    flip(dataset / ACTIONS, 40)
    with pytest.warns(RemoteSkippedWarning, match="wrong bytes"):
        done = repair(dataset, remotes=offer(monkeypatch, shelf), progress=False)
    assert {each.file: each.how.split()[0] for each in done} == {ACTIONS: "fetched", STATES: "made"}
    assert contents(dataset) == before


def test_other_bits_than_were_written_are_not_swapped_in(
    dataset: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A platform that simulates differently cannot repair, and says so."""
    flip(dataset / STATES, 40)
    before = contents(dataset)
    monkeypatch.setattr(
        repair_module, "build", lambda recipe, out, **options: make_tiny(out, seed=8)
    )
    with pytest.raises(DatasetError, match=r"states/c.0.0 .* other bytes than were written"):
        repair(dataset, progress=False)
    assert contents(dataset) == before


@pytest.mark.usefixtures("published")
@pytest.mark.parametrize("damage", ["flipped", *slow("absent", "empty")])
def test_a_lost_manifest_of_a_published_dataset_is_restored(dataset: Path, damage: str) -> None:
    before = contents(dataset)
    if damage == "absent":
        (dataset / "manifest.json").unlink()
    elif damage == "flipped":
        flip(dataset / "manifest.json", 500)
    else:
        (dataset / "manifest.json").write_bytes(b"")
    assert [each.file for each in examine(dataset)] == ["manifest.json"]
    (done,) = repair(dataset)

    assert done.how == "made again from the recipe"
    assert contents(dataset) == before, "the same manifest, bit for bit"


@pytest.mark.slow
def test_an_unpublished_manifest_needs_all_other_files(dataset: Path) -> None:
    before = contents(dataset)
    (dataset / "manifest.json").unlink()
    assert repair(dataset, progress=False) == (
        Repair("manifest.json", "made again from the recipe"),
    )
    assert contents(dataset) == before
    (dataset / "manifest.json").unlink()
    flip(dataset / STATES, 40)
    with pytest.raises(ManifestError, match=r"states/c.0.0 is not the file that"):
        repair(dataset, progress=False)


@pytest.mark.slow
def test_an_unpublished_manifest_comes_from_a_remote_that_has_the_same_files(
    dataset: Path, tiny: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = contents(dataset)
    other = Shelf(tmp_path / "1", make_tiny(tmp_path / "other", seed=9))
    made = len(OneProcessCrew.made)
    right = Shelf(tmp_path / "2", tiny)
    (dataset / "manifest.json").unlink()
    (done,) = repair(dataset, remotes=offer(monkeypatch, other, right), progress=False)
    assert done == Repair("manifest.json", f"fetched from {right.address}/{TINY.id}")
    assert contents(dataset) == before
    assert len(OneProcessCrew.made) == made


def test_without_a_recipe_nothing_can_be_made_again(dataset: Path) -> None:
    (dataset / "recipe.json").unlink()
    with pytest.raises(DatasetError, match="package has no recipe of it"):
        repair(dataset, progress=False)


@pytest.mark.usefixtures("published")
@pytest.mark.parametrize("lost", [("manifest.json", "recipe.json"), *slow(("manifest.json",))])
def test_somebodys_own_dataset_under_a_shipped_name_is_never_replaced(
    tmp_path: Path, lost: tuple[str, ...]
) -> None:
    """The recipe's hash beside the arrays tells."""
    own = make_tiny(tmp_path / TINY.id, seed=6)
    flip(own / STATES, 40)
    for name in lost:
        (own / name).unlink()
    before = contents(own)
    with pytest.raises(DatasetError):
        repair(own, progress=False)
    assert contents(own) == before


def test_a_recipe_that_nobody_has_is_not_made_up(dataset: Path) -> None:
    recipe = json.loads((dataset / "recipe.json").read_bytes())
    (dataset / "recipe.json").write_text(json.dumps({**recipe, "seed": 77}))
    (dataset / "manifest.json").unlink()
    before = contents(dataset)
    with pytest.raises(DatasetError, match=r"recipe\.json is not the one it was made from"):
        repair(dataset, progress=False)
    assert contents(dataset) == before


FLIPPED_BYTES = st.none() | st.integers(0, 200)  # None: the file is absent


@pytest.mark.slow
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=1)
@given(
    damage=st.dictionaries(st.sampled_from([*FILES, "manifest.json"]), FLIPPED_BYTES, min_size=1)
)
@example(damage={"recipe.json": None, STATES: 40, "manifest.json": None})
@example(damage={"recipe.json": 60, "manifest.json": None})
@example(damage={"card.md": None, STATES: 40})
def test_any_set_of_files_is_repaired(
    tiny: Path, published: Published, damage: dict[str, int | None]
) -> None:
    # without manifest and root group, nothing tells a dataset from another folder
    assume(not {"manifest.json", "data.zarr/zarr.json"} <= damage.keys())
    with TemporaryDirectory(dir=tiny.parent) as folder:  # a copy for each example
        dataset = Path(shutil.copytree(tiny, Path(folder) / TINY.id))
        before = contents(dataset)
        for file, byte in damage.items():
            if byte is None:
                (dataset / file).unlink()
            else:
                flip(dataset / file, byte % len(before[file]))
        assert {each.file for each in repair(dataset, progress=False)} == set(damage)
        assert contents(dataset) == before
