"""Datasets of one's own task and policies: copies of networks, shares, recipes, errors."""

import shutil
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch", reason="training needs the torch extra")

import swarmdata
from swarmdata.audit import problems_of
from swarmdata.building.build import build
from swarmdata.building.parts_folder import build_folder
from swarmdata.errors import CheckpointError, SpecError, UnknownNameError
from swarmdata.evaluation.runs.generated_dataset import generate
from swarmdata.evaluation.runs.named_policies import Behavior
from swarmdata.evaluation.runs.train import train, train_online
from swarmdata.hub.catalog.repair import examine, repair
from swarmdata.registry.presets import preset
from swarmdata.registry.recipes import against
from swarmdata.specs.recipe import PolicySource, Recipe, who_acts
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.store import read_manifest
from swarmdata.store.stored_dataset import open_store
from tests.support.tiny import Shelf

pytestmark = pytest.mark.usefixtures("one_process")

SPEC = TaskSpec(horizon=40)
TRAINING = {"n_updates": "2", "hidden": "8"}


@pytest.fixture(scope="module")
def runs(tiny: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Runs of two seeds each: one whose network is exact, one whose network is not."""
    folder = tmp_path_factory.mktemp("runs")
    for name, changes in {"bc": TRAINING, "vdn": TRAINING}.items():
        train(name, str(tiny), folder / name, n_seeds=2, changes=changes, progress=False)
    return folder


@pytest.fixture(scope="module")
def mine(runs: Path, tmp_path_factory: pytest.TempPathFactory) -> swarmdata.Dataset:
    return generate(
        SPEC, {str(runs / "bc"): 2, str(runs / "vdn"): 1, "scripted": 0.5, "random": 0.5},
        id="coop_nav-mine-v0", n_steps=1200, noise=0.1, progress=False,
        out=tmp_path_factory.mktemp("mine") / "data",
    )  # fmt: skip


@pytest.mark.slow
def test_a_run_becomes_one_behavior_policy_for_each_seed(mine: swarmdata.Dataset) -> None:
    recipe = mine.recipe.recipe
    assert recipe is not None
    found = {p.label: (p.name, p.share, p.noise) for p in recipe.policies}
    assert found == {
        "bc-0": ("learned", 1.0, 0.1),
        "bc-1": ("learned", 1.0, 0.1),
        "vdn-0": ("network", 0.5, 0.1),
        "vdn-1": ("network", 0.5, 0.1),
        "scripted": ("scripted", 0.5, 0.1),
        "random": ("random", 0.5, 0.0),
    }
    kept = {path.name for path in (mine.path / "checkpoints").iterdir()}
    assert kept == {p.checkpoint for p in recipe.policies if p.checkpoint}
    steps = np.bincount(mine.episodes.policy, weights=mine.episodes.lengths)
    np.testing.assert_allclose(steps / steps.sum(), np.array([2, 2, 1, 1, 1, 1]) / 8, atol=0.05)


@pytest.mark.slow
def test_it_passes_the_audit_and_its_card_marks_inexact_networks(mine: swarmdata.Dataset) -> None:
    assert problems_of(mine.path) == ()
    card = (mine.path / "card.md").read_text()
    assert "episodes of all policies but vdn-0, vdn-1" in card
    assert "`network` runs those that cannot be run so" in card


@pytest.mark.slow
def test_its_recipe_makes_it_again_without_the_runs(
    mine: swarmdata.Dataset, tmp_path: Path
) -> None:
    moved = tmp_path / "elsewhere"
    shutil.copytree(mine.path, moved)
    recipe = Recipe.from_file(moved / "recipe.json")
    again = build(recipe, tmp_path / "again", checkpoints=moved, progress=False)
    assert read_manifest(again) == read_manifest(mine.path)
    assert not build_folder(tmp_path / "again").exists()
    with pytest.raises(CheckpointError, match=r"'bc-0' needs the checkpoint .* build from the rec"):
        build(recipe, tmp_path / "lost", progress=False)
    assert not (tmp_path / "lost.build").exists()


@pytest.mark.slow
def test_a_killed_build_goes_on_without_the_runs(mine: swarmdata.Dataset, tmp_path: Path) -> None:
    recipe = Recipe.from_file(mine.path / "recipe.json")
    parts = build_folder(tmp_path / "out")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("swarmdata.building.build.assemble", _killed)
        with pytest.raises(KeyboardInterrupt):
            build(recipe, tmp_path / "out", checkpoints=mine.path, progress=False)
    assert (parts / "checkpoints").is_dir()
    build(recipe, tmp_path / "out", progress=False)
    assert read_manifest(tmp_path / "out").digest == mine.digest
    assert not parts.exists()


def _killed(*arguments: object, **options: object) -> None:
    raise KeyboardInterrupt


@pytest.mark.slow
def test_damaged_arrays_are_repaired_and_a_damaged_network_is_named(
    mine: swarmdata.Dataset, tmp_path: Path
) -> None:
    data = tmp_path / "data"
    shutil.copytree(mine.path, data)
    rewards = data / "data.zarr/rewards/c.0.0"
    rewards.write_bytes(b"\0" * rewards.stat().st_size)
    assert [each.file for each in repair(data, progress=False)] == ["data.zarr/rewards/c.0.0"]
    network = next((data / "checkpoints").iterdir())
    network.write_bytes(b"x" * network.stat().st_size)
    assert [each.file for each in examine(data)] == [f"checkpoints/{network.name}"]
    with pytest.raises(CheckpointError, match=f"{network.name} has SHA-256"):
        repair(data, progress=False)
    with pytest.raises(swarmdata.SwarmdataError, match=network.name):
        open_store(data, "full")


@pytest.mark.slow
def test_networks_travel_to_remotes_and_into_edits(mine: swarmdata.Dataset, tmp_path: Path) -> None:
    shelf = Shelf(tmp_path / "shelf", mine.path)
    fetched = swarmdata.load(f"{shelf.address}/{mine.id}", progress=False)
    names = {path.name for path in (mine.path / "checkpoints").iterdir()}
    assert {path.name for path in (fetched.path / "checkpoints").iterdir()} == names
    edit = swarmdata.filter_dataset(mine, tmp_path / "edit", id="coop_nav-some-v0", policy="bc-0")
    (kept,) = (edit.path / "checkpoints").iterdir()
    assert kept.name.startswith("bc-0-")
    assert problems_of(edit.path) == ()


@pytest.mark.slow
def test_online_runs_and_tiers_act_too(tmp_path: Path) -> None:
    small = {"n_copies": "4", "rollout_steps": "4", "hidden": "8", "minibatch": "64"}
    changes = {**small, "n_steps": "32"}
    train_online("mappo", "coop_nav", tmp_path / "on", seeds=[4], changes=changes, progress=False)
    made = generate(
        "coop_nav", [tmp_path / "on", "expert"], id="coop_nav-on-v0", n_steps=1300, progress=False
    )
    assert [p.label for p in made.recipe.policies] == ["on-4", *(f"expert-{k}" for k in range(4))]
    assert {p.name for p in made.recipe.policies} == {"learned"}
    assert swarmdata.load("coop_nav-on-v0").digest == made.digest
    assert len(list((made.path / "checkpoints").iterdir())) == 1  # the package has the experts


def test_all_that_an_online_run_saved_makes_replay_data(tmp_path: Path) -> None:
    small = {"n_copies": "4", "rollout_steps": "4", "hidden": "8", "n_steps": "32"}
    train_online(
        "mappo", SPEC, tmp_path / "on", seeds=[0, 4], changes=small, n_checkpoints=2, progress=False
    )
    saved = sorted((tmp_path / "on" / "policies").glob("*/*.safetensors"))
    labels = [f"on-{file.parent.name.removeprefix('seed-')}-{int(file.stem)}" for file in saved]
    assert len(labels) > 2
    made = generate(
        SPEC, tmp_path / "on" / "policies", id="coop_nav-replay-v0", n_steps=40 * len(labels),
        out=tmp_path / "data", progress=False,
    )  # fmt: skip
    assert [each.label for each in made.recipe.policies] == labels
    hashes = {each.sha256 for each in made.recipe.policies}
    assert len(hashes) == len(labels)
    (tmp_path / "policies").mkdir()
    with pytest.raises(SpecError, match="policies is not a run folder"):
        generate(SPEC, tmp_path / "policies", id="coop_nav-x-v0", out=tmp_path / "x")


def test_a_team_with_a_network_is_not_exact() -> None:
    learned, network = (
        PolicySource(label=name, name=name, checkpoint=f"{name}.safetensors", sha256="0" * 64)
        for name in ("learned", "network")
    )
    team = against((learned, network), ("pursuers", "evader"), "both")
    assert "not exact" in str(Behavior(team, 0.005))
    assert "exact; rounded" in str(Behavior(learned, 0.005))


def test_runs_of_sides_act_against_each_other(tmp_path: Path) -> None:
    spec = preset("tag").with_updates(horizon=20)
    changes = {"n_copies": "4", "rollout_steps": "4", "hidden": "8", "n_steps": "32"}
    for side, seeds in (("pursuers", [0, 1]), ("evader", [0])):
        train_online(
            "dagger", spec, tmp_path / side, side=side, opponents="scripted", seeds=seeds,
            changes={**changes, "frame": "auto"}, n_checkpoints=1, progress=False,
        )  # fmt: skip
    first, second = tmp_path / "pursuers", tmp_path / "evader"
    made = generate(
        spec, {f"{first},{second}": 1, f"random,{second}": 1}, id="tag-mine-v0", n_steps=400,
        noise=0.1, out=tmp_path / "data", progress=False,
    )  # fmt: skip
    recipe = Recipe.from_file(made.path / "recipe.json")
    labels = ["pursuers-0-vs-evader-0", "pursuers-1-vs-evader-0", "random-vs-evader-0"]
    assert [each.label for each in recipe.policies] == labels
    assert {each.opponents[0].name for each in recipe.policies} == {"learned"}
    kept = {path.name for path in (made.path / "checkpoints").iterdir()}
    assert kept == {each.checkpoint for each in who_acts(recipe.policies)} - {None}
    assert len(kept) == 3
    assert problems_of(made.path) == ()
    assert sorted(kept)[0] in (made.path / "card.md").read_text()
    again = build(recipe, tmp_path / "again", checkpoints=made.path, progress=False)
    assert read_manifest(again).digest == made.digest
    edit = swarmdata.filter_dataset(made, tmp_path / "edit", id="tag-some-v0", policy=labels[2])
    (one,) = (edit.path / "checkpoints").iterdir()
    assert one.name.startswith("evader-0-")
    for names, words in (
        (f"{second},scripted", "not trained for the side pursuers of tag"),
        (f"{first},expert", "unknown registered policy, tier or run folder of a side 'expert'"),
        (str(first), "was trained for the side pursuers of tag, and does not act alone"),
    ):
        with pytest.raises(swarmdata.SwarmdataError, match=words):
            generate(spec, names, id="tag-x-v0", out=tmp_path / "x", progress=False)
    with pytest.raises(SpecError, match="not trained for the side pursuers of tag as it is here"):
        generate("tag", f"{first},idle", id="tag-x-v0", out=tmp_path / "x", progress=False)


@pytest.mark.parametrize(
    ("policies", "options", "error", "message"),
    [
        ([], {}, SpecError, "no policies, expected at least one"),
        ("randm", {}, UnknownNameError, "Did you mean 'random'"),
        ("runs/absent", {}, SpecError, "runs/absent is not a run folder"),
        ({"random": 0.0}, {}, SpecError, "positive number, got random 0"),
        (["idle", "idle"], {}, SpecError, "named twice: idle"),
        (["idle", "random"], {"noise": 0.1}, SpecError, "idle, random has action noise"),
        ("expert", {}, UnknownNameError, "unknown policy, tier or run folder 'expert'"),
        ("learned", {}, UnknownNameError, "unknown policy, tier or run folder 'learned'"),
        ("idle", {"id": "coop_nav-medium-v1"}, SpecError, "is the id of a dataset of the package"),
        ("idle", {"id": "Mine"}, SpecError, "invalid Recipe in the recipe of Mine: id"),
        (["idle", "random"], {"n_steps": 79}, SpecError, "leave 40 to policy 'idle', .* least 80"),
    ],
)
def test_what_cannot_be_made_is_refused_in_one_sentence(
    tmp_path: Path, policies: object, options: dict[str, object], error: type[Exception],
    message: str,
) -> None:  # fmt: skip
    settings = {"id": "coop_nav-mine-v0", "n_steps": 80, "out": tmp_path / "out", **options}
    with pytest.raises(error, match=message):
        generate(SPEC, policies, progress=False, **settings)  # type: ignore[arg-type]


def test_author_and_license_are_the_authors_and_seeds_follow_from_the_id(tmp_path: Path) -> None:
    made = {
        folder: generate(
            SPEC, "random", id=f"coop_nav-{name}-v0", n_steps=200, progress=False,
            out=tmp_path / folder, metadata=metadata,
        )
        for folder, name, metadata in (
            ("stated", "mine", {"author": "A. Turing", "license": "mit"}),
            ("silent", "mine", None), ("other", "other", None),
        )
    }  # fmt: skip
    cards = {name: dataset.card for name, dataset in made.items()}
    assert "license: mit\n" in cards["stated"]
    assert "A. Turing" in cards["stated"]
    assert "license: unknown\n" in cards["silent"]
    assert made["stated"].digest == made["silent"].digest
    seeds = [set(made[name].episodes.seeds.tolist()) for name in ("silent", "other")]
    assert not seeds[0] & seeds[1]
    again = Recipe.from_file(made["stated"].path / "recipe.json")
    assert again.metadata == {"author": "A. Turing", "license": "mit"}
    assert "metadata" not in made["silent"].recipe.to_json(), "older recipes keep their hashes"
