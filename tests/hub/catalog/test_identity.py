"""What a folder is: one verdict, each with a sentence that is true; every command asks for it."""

import json
import shutil
import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from swarmdata.building.build import build
from swarmdata.cards.card import write_card
from swarmdata.cli.main import app
from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import ChecksumError, ManifestError, RecipeConflictError
from swarmdata.hub.catalog import identity, request
from swarmdata.hub.catalog.catalog import AnotherDatasetWarning, RebuiltDifferentlyWarning, load
from swarmdata.hub.catalog.identity import judge
from swarmdata.hub.catalog.repair import examine, find_blockers
from swarmdata.hub.catalog.request import request_of_address
from swarmdata.hub.catalog.sources import Remotes, obtain
from swarmdata.registry.published import Published
from swarmdata.runtime.cache_folder import cache_folder
from swarmdata.specs.recipe import Recipe
from swarmdata.specs.task_spec import Role
from swarmdata.store import Manifest, open_store, read_manifest
from swarmdata.store.arrays.layout import array_file
from swarmdata.store.manifest import note_build
from swarmdata.store.stored_dataset import Verify
from tests.support.command_line import run
from tests.support.pairs import slow
from tests.support.signed_again import sign_again
from tests.support.tiny import TINY, Shelf, flip, make_tiny

RUNNER = CliRunner()
ROOT = "data.zarr/zarr.json"


pytestmark = pytest.mark.usefixtures("one_process", "published")


def forge(folder: Path, recipe: Recipe) -> Manifest:
    """Makes manifest and attributes anew for whatever is there, as a forger would."""
    (folder / "recipe.json").write_text(recipe.to_json())
    root = json.loads((folder / ROOT).read_bytes())
    root["attributes"]["recipe_hash"] = recipe.hash()
    (folder / ROOT).write_text(json.dumps(root))
    return sign_again(folder, recipe)


def changed(recipe: Recipe, **changes: Any) -> Recipe:
    return Recipe.parse({**recipe.model_dump(), **changes})


def other_reward(recipe: Recipe) -> Recipe:
    rules = recipe.spec.rules.model_dump()
    rules["rewards"]["progress"] *= 10
    return changed(recipe, spec=recipe.spec.with_updates(rules=rules).model_dump())


def other_label(recipe: Recipe) -> Recipe:
    first, *rest = (policy.model_dump() for policy in recipe.policies)
    return changed(recipe, policies=[{**first, "label": "expert-0"}, *rest])


def change_rewards(folder: Path, recipe: Recipe = TINY) -> Manifest:
    """Adds 1 to every reward, and signs what came out."""
    file = folder / array_file("rewards", 2)
    shape = read_manifest(folder).arrays["rewards"].shape
    content = bytearray(file.read_bytes())
    values = np.frombuffer(content, dtype=np.float32, count=int(np.prod(shape)))
    values[:] = values + 1
    file.write_bytes(content)
    return forge(folder, recipe)


@dataclass(frozen=True)
class Case:
    """Something that is not the published dataset, under its name."""

    forge: Callable[[Path], object]
    words: str  # of its sentence


CASES = {
    "tier": Case(lambda d: forge(d, changed(TINY, tier="expert")), "a recipe that was not pub"),
    "label": Case(lambda d: forge(d, other_label(TINY)), "a recipe that was not published"),
    "reward": Case(lambda d: forge(d, other_reward(TINY)), "a recipe that was not published"),
    "rewards": Case(change_rewards, "no record that they were built on this"),
    "both": Case(lambda d: change_rewards(d, changed(TINY, seed=77)), "neither arrays"),
}


@pytest.fixture(params=[*slow("tier", "reward"), "label", "rewards", "both"])
def case(request: pytest.FixtureRequest, dataset: Path) -> Case:
    """A forged dataset in `dataset`."""
    found = CASES[request.param]
    found.forge(dataset)
    write_card(dataset)
    return found


def test_the_published_dataset(dataset: Path) -> None:
    found = judge(read_manifest(dataset))
    assert (found.kind, found.sentence) == ("published", f"this is the published dataset {TINY.id}")
    result = RUNNER.invoke(app, ["verify", str(dataset)])
    assert (result.exit_code, found.sentence in result.stdout) == (0, True)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        load(dataset)


def test_a_forgery_is_sound_and_every_command_says_what_it_is(
    dataset: Path, case: Case, tmp_path: Path
) -> None:
    """Row 40: every checksum is right; it is neither fetched nor published."""
    assert examine(dataset) == ()
    found = judge(read_manifest(dataset))
    assert found.kind == "another"
    assert f"another dataset under the published name {TINY.id}" in found.sentence
    assert case.words in found.sentence
    for options in ([], ["--repair"]):
        result = RUNNER.invoke(app, ["verify", str(dataset), *options])
        assert (result.exit_code, case.words in result.stderr) == (1, True)
        assert "this is the published dataset" not in result.output
    with pytest.warns(AnotherDatasetWarning, match=case.words) as caught:
        load(dataset)
    assert [warning.category for warning in caught] == [AnotherDatasetWarning]
    assert any(case.words in reason for reason in find_blockers(dataset))

    shelf = Shelf(tmp_path / "shelf", dataset)
    address = f"{shelf.address}/{TINY.id}"
    with pytest.raises(ChecksumError, match=case.words):
        obtain(request_of_address(address), Remotes(progress=False))
    for options in ([address], [address, "--out", str(tmp_path / "out")],
                    [TINY.id, "--from", shelf.address]):  # fmt: skip
        result = RUNNER.invoke(app, ["pull", *options])
        assert (result.exit_code, case.words in result.stderr) == (1, True)
    left = list(tmp_path.rglob("manifest.json"))
    assert sorted(left) == sorted(
        [dataset / "manifest.json", tmp_path / "shelf" / TINY.id / "manifest.json"]
    )


def test_whatever_is_wrong_keeps_a_dataset_from_being_pushed(dataset: Path) -> None:
    assert find_blockers(dataset) == ()
    card = (dataset / "card.md").read_text()
    (dataset / "card.md").write_text(card.replace("1", "2"))
    (reason,) = find_blockers(dataset)
    assert "of card.md is" in reason
    (dataset / "card.md").unlink()
    (reason,) = find_blockers(dataset)
    assert "there is no card.md" in reason
    flip(dataset / "data.zarr/states/c.0.0", -1)
    (reason,) = find_blockers(dataset)  # the only reason that counts
    assert "data.zarr/states/c.0.0" in reason


def test_what_was_built_here_is_known_to_be(
    tmp_path: Path, published: Published, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By a record in the cache, which a copy from elsewhere does not bring along."""
    other = replace(published, digest="0" * 64)
    monkeypatch.setattr(identity, "published", lambda: {TINY.id: other})
    folder = build(TINY, tmp_path / "d", workers=1, progress=False)
    found = judge(read_manifest(folder))
    assert found.kind == "rebuilt"
    assert "was built here from the published recipe" in found.sentence
    assert "so this machine computes something else" in found.sentence
    with pytest.warns(RebuiltDifferentlyWarning, match="built here"):
        load(folder)
    older = replace(other, made_with={"pymunk": "1.2.3"})
    monkeypatch.setattr(identity, "published", lambda: {TINY.id: older})
    assert "instead of 1.2.3" in judge(read_manifest(folder)).sentence

    shutil.rmtree(cache_folder() / "built")
    elsewhere = judge(read_manifest(folder))
    assert elsewhere.kind == "another"
    assert "no record that they were built on this machine" in elsewhere.sentence
    run("verify", str(folder), code=1)


def test_a_record_is_of_one_dataset(dataset: Path) -> None:
    """Changed afterwards, it is no longer what was built here."""
    note_build(read_manifest(dataset))
    assert judge(change_rewards(dataset)).kind == "another"


def test_a_cache_that_cannot_be_written_to_has_no_records(
    dataset: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("SWARMDATA_CACHE", str(tmp_path / "file"))
    note_build(read_manifest(dataset))
    assert judge(read_manifest(dataset)).kind == "published"


def test_nothing_is_known_of_an_id_that_nobody_has_published(tmp_path: Path) -> None:
    folder = make_tiny(tmp_path / "mine", id="coop_nav-mine-v0")
    found = judge(read_manifest(folder))
    assert (found.kind, found.is_as_named) == ("unknown", True)
    assert found.sentence.startswith("no digest is published for coop_nav-mine-v0")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        load(folder)


def test_a_shipped_id_that_is_not_published_has_its_recipe(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(identity, "published", dict)
    found = judge(read_manifest(make_tiny(tmp_path / TINY.id, n_steps=200)))
    assert (found.kind, "another dataset under the shipped name" in found.sentence) == (
        "another",
        True,
    )


def test_a_shortened_recipe_in_the_cache_is_not_the_shipped_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(request, "find_recipe", lambda name: TINY)
    make_tiny(cache_folder() / "datasets" / TINY.id, n_steps=200)
    with pytest.raises(RecipeConflictError, match="made from another recipe"):
        load(TINY.id)


# --- recipe and arrays are held together ---


@pytest.mark.parametrize("key", ["recipe_hash", "id"])
def test_another_identity_beside_the_arrays_is_refused(dataset: Path, key: str) -> None:
    """Though every checksum is right."""
    root = json.loads((dataset / ROOT).read_bytes())
    root["attributes"][key] = "0" * 64
    (dataset / ROOT).write_text(json.dumps(root))
    sign_again(dataset, TINY)
    with pytest.raises(ManifestError, match=f"says {key} '0000"):
        open_store(dataset, "none")


def test_a_dataset_without_the_hash_is_read(dataset: Path, published: Published) -> None:
    """As all were that were written before."""
    root = json.loads((dataset / ROOT).read_bytes())
    del root["attributes"]["recipe_hash"]
    (dataset / ROOT).write_text(json.dumps(root))
    manifest = sign_again(dataset, TINY)
    assert manifest.transport_digest != published.transport_digest
    assert open_store(dataset, "full").manifest.digest == published.digest
    assert judge(manifest).kind == "published"


def with_spec(recipe: Recipe, **changes: Any) -> Recipe:
    return changed(
        recipe, id="coop_nav-own-v0", spec=recipe.spec.with_updates(**changes).model_dump()
    )


SPECS: dict[str, tuple[dict[str, Any], str]] = {
    "agents": ({"team": (Role(count=5).model_dump(),)}, r"actions has rows of shape \[4, 2\], exp"),
    "actions": (
        {"communication": {"kind": "broadcast", "payload": "learned", "message_size": 3}},
        r"actions has rows of shape \[4, 2\], expected \[4, 5\]",
    ),
}
WIDTHS: dict[str, tuple[dict[str, Any], str]] = {
    "observations": (
        {"observation": {"kind": "lidar"}}, r"observations has rows of shape \[4, 53\], expected"
    ),
    "states": ({"rules": {"task": "coop_nav", "goals": "unassigned"}}, "states has rows of shape"),
    "messages": ({"communication": {"kind": "broadcast"}}, r"sent has rows of shape \[4, 0\]"),
    "layouts": ({"obstacles": {"circles": 9}}, "episodes/layouts has rows of shape"),
}  # fmt: skip


@pytest.mark.parametrize("name", SPECS)
def test_a_spec_that_contradicts_the_team_is_refused_on_opening(dataset: Path, name: str) -> None:
    """Five robots over arrays of four were shown as "5 agents"."""
    changes, words = SPECS[name]
    recipe = with_spec(TINY, **changes)
    _rename(dataset, recipe)
    levels: tuple[Verify, ...] = ("none", "fast", "full")
    for verify in levels:
        with pytest.raises(ManifestError, match=words):
            Dataset.open(dataset, verify)


@pytest.mark.parametrize("name", WIDTHS)
def test_a_spec_that_contradicts_the_widths_is_refused(
    dataset: Path, name: str, tmp_path: Path
) -> None:
    changes, words = WIDTHS[name]
    recipe = with_spec(TINY, **changes)
    _rename(dataset, recipe)
    with pytest.raises(ManifestError, match=words):
        load(dataset)
    result = RUNNER.invoke(app, ["verify", str(dataset)])
    assert (result.exit_code, "by the spec" in result.stderr) == (1, True)
    (reason,) = find_blockers(dataset)
    assert "by the spec" in reason
    shelf = Shelf(tmp_path / "shelf", dataset)
    result = RUNNER.invoke(app, ["pull", f"{shelf.address}/{recipe.id}"])
    assert (result.exit_code, "by the spec" in result.stderr) == (1, True)


def _rename(folder: Path, recipe: Recipe) -> None:
    root = json.loads((folder / ROOT).read_bytes())
    root["attributes"]["id"] = recipe.id
    (folder / ROOT).write_text(json.dumps(root))
    forge(folder, recipe)


def test_a_folder_named_like_another_dataset_says_so(
    monkeypatch: pytest.MonkeyPatch, tiny: Path, tmp_path: Path
) -> None:
    """Row 81: in the cache, where its name is what is asked for, and anywhere else."""
    monkeypatch.setattr(identity, "published", lambda: MappingProxyType({}))
    monkeypatch.setenv("SWARMDATA_CACHE", str(tmp_path))
    folder = Path(shutil.copytree(tiny, tmp_path / "datasets" / "lab-warehouse_run-v3"))
    holds = f"is named like {folder.name}, and holds {TINY.id}"
    with pytest.warns(AnotherDatasetWarning, match=holds):
        assert load(folder.name, offline=True).id == TINY.id
    with pytest.warns(AnotherDatasetWarning, match=holds):
        load(folder)
    for command in ("info", "verify"):
        result = RUNNER.invoke(app, [command, str(folder)])
        assert result.exit_code == 0, result.output
        assert holds in result.stderr
    assert holds in RUNNER.invoke(app, ["list"]).stderr
    for name in (TINY.id, "mine"):
        folder = folder.rename(tmp_path / name)
        with warnings.catch_warnings(action="error"):
            load(folder)
        assert "is named like" not in RUNNER.invoke(app, ["info", str(folder)]).output
