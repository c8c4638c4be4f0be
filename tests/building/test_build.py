"""Builds: the same bits for any number of workers and after any kill; conflicts; waves; space."""

import random
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

import swarmdata
from swarmdata.building import build as build_module
from swarmdata.building.build import build
from swarmdata.building.part_maker import make_part, part_maker
from swarmdata.building.parts_folder import Parts, build_folder
from swarmdata.datasets.dataset import Dataset
from swarmdata.envs.world.task_env import TaskEnv
from swarmdata.errors import BuildError, DatasetError, RecipeConflictError
from swarmdata.numerics.random import EVALUATION_BASE
from swarmdata.registry.components import make_env
from swarmdata.rollouts.recipe_episodes import episode_seeds
from swarmdata.specs.recipe import PolicySource, Recipe
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.store import assembly, read_manifest
from swarmdata.store.arrays.shards import write_shard
from tests.support.one_process import OneProcessCrew, use_one_process
from tests.support.own_task import nothing_registered
from tests.support.tiny import abandoned

SCRIPT = """
import sys
from pathlib import Path
sys.path[:] = {path!r}
from swarmdata.building.build import build
from swarmdata.specs.recipe import Recipe
build(Recipe.from_file(Path(sys.argv[1])), Path(sys.argv[2]), workers=2)
"""


def make_recipe(n_steps: int = 1500, part_episodes: int = 4, **changes: Any) -> Recipe:
    fields: dict[str, Any] = {
        "id": "coop_nav-tiny-v0",
        "tier": "tiny",
        "spec": TaskSpec(horizon=40),
        "policies": (
            PolicySource(label="a", name="random"),
            PolicySource(label="b", name="straight", share=2.0),
        ),
        "seed": 5,
        "n_steps": n_steps,
        "part_episodes": part_episodes,
    }
    return Recipe(**{**fields, **changes})


@pytest.fixture
def one_process(monkeypatch: pytest.MonkeyPatch) -> type[OneProcessCrew]:
    use_one_process(monkeypatch)
    return OneProcessCrew


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The tiny recipe's dataset, built without workers."""
    with pytest.MonkeyPatch.context() as patch:
        use_one_process(patch)
        return build(make_recipe(), tmp_path_factory.mktemp("one") / "d", progress=False)


@pytest.fixture(scope="module")
def digest(whole: Path) -> str:
    return read_manifest(whole).digest


def start_build(folder: Path, out: Path) -> "subprocess.Popen[bytes]":
    path = folder / "recipe.json"
    path.write_text(make_recipe().to_json())
    command = [sys.executable, "-c", SCRIPT.format(path=sys.path), str(path), str(out)]
    return subprocess.Popen(command, start_new_session=True)


@pytest.mark.slow
def test_kills_at_random_moments_change_nothing(tmp_path: Path, digest: str) -> None:
    out, rng = tmp_path / "d", random.Random(3)
    for _ in range(3):
        process = start_build(tmp_path, out)
        while process.poll() is None and not build_folder(out).exists():
            time.sleep(0.02)
        time.sleep(rng.uniform(0.0, 3.0))
        process.send_signal(signal.SIGKILL)  # its workers live on for a moment
        process.wait()
    assert start_build(tmp_path, out).wait() == 0

    assert read_manifest(out).digest == digest
    assert not build_folder(out).exists()
    Dataset.open(out, verify="full")


@pytest.mark.slow
def test_processes_that_build_at_once_agree(tmp_path: Path, digest: str) -> None:
    processes = [start_build(tmp_path, tmp_path / "d") for _ in range(3)]

    assert [process.wait() for process in processes] == [0, 0, 0]
    assert read_manifest(tmp_path / "d").digest == digest


@pytest.mark.usefixtures("one_process")
def test_finished_parts_are_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, digest: str
) -> None:
    with monkeypatch.context() as patch:
        full = OSError(28, "No space left on device")
        patch.setattr(build_module, "assemble", Mock(side_effect=full))
        with pytest.raises(OSError, match="No space"):
            build(make_recipe(), tmp_path / "d", progress=False)
    n_parts = len(OneProcessCrew.made)
    build(make_recipe(), tmp_path / "d", progress=False)

    assert len(OneProcessCrew.made) == n_parts > 0
    assert read_manifest(tmp_path / "d").digest == digest


@pytest.mark.slow
@pytest.mark.usefixtures("one_process")
def test_a_smaller_recipe_makes_the_first_episodes(tmp_path: Path) -> None:
    small = build(make_recipe(300, part_episodes=3), tmp_path / "small", progress=False)
    large = build(make_recipe(900), tmp_path / "large", progress=False)

    first, second = Dataset.open(small), Dataset.open(large)
    assert 300 <= first.n_steps < 340
    assert len(first) < len(second)
    for one, other in zip(first, second, strict=False):
        assert (one.seed, one.policy) == (other.seed, other.policy)
        np.testing.assert_array_equal(one.observations, other.observations)
        np.testing.assert_array_equal(one.actions, other.actions)


@pytest.mark.slow
def test_little_is_made_in_vain(tmp_path: Path, one_process: type[OneProcessCrew]) -> None:
    recipe = make_recipe()
    build(recipe, tmp_path / "d", progress=False)

    needed = recipe.n_steps / 40 / recipe.part_episodes
    assert len(one_process.made) == len(set(one_process.made))
    assert needed <= len(one_process.made) <= needed + 2 * len(recipe.policies)


@pytest.mark.usefixtures("one_process")
def test_of_a_finished_dataset_only_a_lost_card_is_written_again(
    whole: Path, tmp_path: Path
) -> None:
    out = Path(shutil.copytree(whole, tmp_path / "d"))
    before, card = snapshot(tmp_path), (out / "card.md").read_text()
    build(make_recipe(), out, progress=False)
    assert snapshot(tmp_path) == before
    (out / "card.md").unlink()
    build(make_recipe(), out, progress=False)
    assert (out / "card.md").read_text() == card


@pytest.mark.usefixtures("one_process")
def test_what_a_kill_after_the_last_file_left_goes(whole: Path, tmp_path: Path) -> None:
    out = Path(shutil.copytree(whole, tmp_path / "d"))
    left = abandoned(out / "card.md")
    build(make_recipe(), out, progress=False)
    assert not left.exists()


def snapshot(folder: Path) -> dict[Path, int]:
    return {path: path.stat().st_mtime_ns for path in folder.rglob("*")}


@pytest.mark.usefixtures("one_process")
def test_other_recipe_in_the_dataset_is_refused(whole: Path) -> None:
    with pytest.raises(RecipeConflictError, match="another recipe"):
        build(make_recipe(seed=6), whole, progress=False)


def test_other_recipe_in_the_parts_is_refused_with_what_differs(tmp_path: Path) -> None:
    folder = build_folder(tmp_path / "d")
    folder.mkdir()
    there = make_recipe(seed=6, spec=TaskSpec(horizon=41))
    (folder / "recipe.json").write_text(there.to_json())

    with pytest.raises(RecipeConflictError) as error:
        build(make_recipe(), tmp_path / "d", progress=False)
    assert "seed is 6 there, 5 in the recipe" in str(error.value)
    assert "spec.horizon is 41 there, 40 in the recipe" in str(error.value)
    assert "n_steps" not in str(error.value)


@pytest.mark.usefixtures("one_process")
def test_parts_of_changed_code_are_refused_and_datasets_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    package = tmp_path / "lazy_robots"
    package.mkdir()
    (package / "__init__.py").write_text(
        "from swarmdata.behavior_policies.simple import Random as Lazy\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    mine = (PolicySource(label="a", name="lazy"),)
    recipe = make_recipe(n_steps=200, policies=mine)
    with nothing_registered():
        swarmdata.register_policy("lazy", "lazy_robots:Lazy")
        parts = Parts(recipe, build_folder(tmp_path / "unfinished"))
        parts.open(None)
        parts.open(None)
        done = build(recipe, tmp_path / "done", progress=False)
        (package / "more.py").write_text("SPEED = 2\n")
        with pytest.raises(
            RecipeConflictError, match="made before the code of policy lazy changed"
        ):
            parts.open(None)
        with pytest.warns(UserWarning, match="was made before the code of policy lazy changed"):
            assert build(recipe, done, progress=False) == done
    assert not build_folder(done).exists()


def test_folder_that_is_no_dataset_is_refused(tmp_path: Path) -> None:
    (tmp_path / "d").mkdir()
    (tmp_path / "d" / "thesis.tex").write_text("precious")

    with pytest.raises(DatasetError, match="manifest"):
        build(make_recipe(), tmp_path / "d", progress=False)
    assert (tmp_path / "d" / "thesis.tex").read_text() == "precious"


@pytest.mark.usefixtures("one_process")
def test_full_disk_is_noticed_before_most_of_the_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(shutil, "disk_usage", lambda path: SimpleNamespace(free=1_000_000))
    recipe = make_recipe(100_000)

    with pytest.raises(BuildError, match=r"needs 1[0-9][0-9] MB more .* 1 MB free"):
        build(recipe, tmp_path / "d", progress=False)
    assert len(OneProcessCrew.made) == len(recipe.policies)


@pytest.mark.slow
@pytest.mark.usefixtures("one_process")
def test_parts_are_joined_without_room_for_a_copy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, digest: str
) -> None:
    """Files of parts are deleted as they are copied; what an interruption leaves is made again."""
    recipe = make_recipe()
    monkeypatch.setattr(Parts, "has_room_for_copy", lambda self: False)
    written: list[str] = []

    def interrupted(folder: Path, name: str, *rest: Any) -> Any:
        entry = write_shard(folder, name, *rest)
        written.append(name)
        if len(written) == 3:
            raise KeyboardInterrupt
        return entry

    monkeypatch.setattr(assembly, "write_shard", interrupted)
    with pytest.raises(KeyboardInterrupt):
        build(recipe, tmp_path / "d", progress=False)
    parts = sorted((tmp_path / "d.build").glob("policy-*"))
    gone = [part for part in parts if not (part / f"{written[0]}.npy").exists()]
    assert gone
    assert len(gone) < len(parts)  # the last of each policy is there until all is done
    made = len(OneProcessCrew.made)
    assert read_manifest(build(recipe, tmp_path / "d", progress=False)).digest == digest
    assert len(OneProcessCrew.made) == made + len(gone)
    assert not (tmp_path / "d.build").exists()


def test_part_is_a_pure_function() -> None:
    recipe, larger = make_recipe(), make_recipe(part_episodes=6)
    few, many = make_env(recipe.spec, 2), make_env(recipe.spec, 16)
    first, again = make_part(recipe, 1, 2, many), make_part(recipe, 1, 2, few)
    same = [*make_part(larger, 1, 1, many), *make_part(larger, 1, 2, many)][2:6]

    assert [episode.seed for episode in first] == [episode.seed for episode in same]
    for one, *others in zip(first, again, same, strict=True):
        for other in others:
            np.testing.assert_array_equal(one.states, other.states)
            np.testing.assert_array_equal(one.actions, other.actions)


def test_seeds_are_distinct_and_never_reserved() -> None:
    recipe = make_recipe()
    seeds = np.concatenate([episode_seeds(recipe, policy, np.arange(50_000)) for policy in (0, 1)])

    assert seeds.dtype == np.uint64
    assert (seeds < EVALUATION_BASE).all()
    assert len(np.unique(seeds)) == len(seeds)


@pytest.mark.slow
def test_policy_that_does_not_exist_is_named(tmp_path: Path) -> None:
    recipe = make_recipe(policies=(PolicySource(label="x", name="rundom"),))

    with pytest.raises(BuildError, match=r"part 0 of x failed: UnknownNameError.*'random'"):
        build(recipe, tmp_path / "d", workers=1, progress=False)


def test_of_two_makers_of_parts_one_begins_with_the_physics(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun: list[int] = []
    monkeypatch.setattr(TaskEnv, "compile_physics", lambda env: begun.append(env.n_copies))
    parts, found = Parts(make_recipe(), tmp_path), []

    for policy, part in ((0, 0), (1, 0), (1, 1)):  # the first two begin a dataset
        part_maker()(parts.job(policy, part).payload, lambda steps: None)
        found.append(len(begun))

    assert found == [0, 1, 1]
