"""Shipping picks the right checkpoints of online runs and writes what recipes need."""

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from swarmdata.behavior_policies.learned import own_actor
from swarmdata.errors import BuildError
from swarmdata.learn.policies.policy_file import load_policy
from swarmdata.learn.training.run_files import Seed, last_policy_path
from swarmdata.online_algos.mappo import MAPPOConfig
from swarmdata.online_algos.runs import checkpoint_selection
from swarmdata.online_algos.runs.checkpoint_selection import find_medium, ship
from swarmdata.online_algos.runs.export_policy import export
from swarmdata.online_algos.runs.online_training import describe_run, train_run
from swarmdata.registry.components import make_env
from swarmdata.registry.presets import preset
from swarmdata.registry.published import side_specs
from swarmdata.registry.recipes import checkpoints, sources
from swarmdata.specs.task_spec import TaskSpec

SPEC, TAG = TaskSpec(horizon=20), preset("tag").with_updates(horizon=20)
SMALL = MAPPOConfig(n_steps=320, n_copies=4, rollout_steps=8, hidden=8, minibatch=64)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short run whose curve pretends to pass the band."""
    folder = tmp_path_factory.mktemp("runs") / "seeds-0-1"
    train_run(describe_run("mappo", SMALL, SPEC, (0, 1), n_checkpoints=10, n_episodes=2), folder)
    pretend(folder, {"96": 0.1, "160": 0.45, "192": 0.5})
    return folder


def pretend(folder: Path, success: dict[str, float]) -> None:
    """Writes successes into a curve, by frames; others are 0.9, or 0.5 where none is given."""
    with (folder / "curve.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    for row in rows:
        row["success"] = str(success.get(row["frames"], 0.9 if success else 0.5))
    with (folder / "curve.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


@pytest.fixture
def half(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every policy solves half of its episodes."""
    monkeypatch.setattr(checkpoint_selection, "measure", lambda *_, **__: {"success": 0.5})


def test_the_medium_is_the_first_checkpoint_in_the_band(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    too_near_the_end, inside = {"success": 0.41}, {"success": 0.44}
    figures = iter([too_near_the_end, inside])
    monkeypatch.setattr(checkpoint_selection, "measure", lambda *_, **__: next(figures))
    medium = find_medium(Seed(run, 1), SPEC, tmp_path)
    assert medium is not None
    assert medium.frames == 192
    monkeypatch.setattr(checkpoint_selection, "measure", lambda *_, **__: {"success": 0.7})
    assert find_medium(Seed(run, 1), SPEC, tmp_path) is None
    with pytest.raises(BuildError, match="none of 1 seeds has a checkpoint"):
        ship([Seed(run, 1)], [], [], "coop_nav", SPEC, tmp_path / "new")


def test_an_exported_policy_acts_as_the_trained_one(run: Path, tmp_path: Path) -> None:
    source = last_policy_path(run, 1)
    export(source, tmp_path / "actor.safetensors", 4)
    step = make_env(SPEC, 8).reset(np.arange(8, dtype=np.uint64))
    exact = own_actor(tmp_path / "actor.safetensors", SPEC).act(step)
    np.testing.assert_allclose(exact, load_policy(source).act(step), atol=0.01)


def test_policies_are_carried_over_to_larger_teams(run: Path, tmp_path: Path) -> None:
    source = last_policy_path(run, 1)
    for n_agents in (4, 8):
        export(source, tmp_path / f"{n_agents}.safetensors", n_agents)
    larger = preset("coop_nav-n8")
    step = make_env(larger, 4).reset(np.arange(4, dtype=np.uint64))
    actions = own_actor(tmp_path / "8.safetensors", larger).act(step)
    first = step._replace(observations=step.observations[:, :4], rewards=step.rewards[:, :4])
    second = step._replace(observations=step.observations[:, 4:], rewards=step.rewards[:, 4:])
    small = own_actor(tmp_path / "4.safetensors", SPEC)
    np.testing.assert_array_equal(actions[:, :4], small.act(first))
    np.testing.assert_array_equal(actions[:, 4:], small.act(second))


@pytest.mark.slow
@pytest.mark.usefixtures("half")
def test_shipping_writes_actors_and_the_index(run: Path, tmp_path: Path) -> None:
    (tmp_path / "index.json").write_text('{"coop_nav": {"other": []}, "formation": {}}')
    both = [Seed(run, 0), Seed(run, 1)]
    ship(both[:1], both, both, "coop_nav", SPEC, tmp_path)
    index = json.loads((tmp_path / "index.json").read_text())
    assert set(index) == {"coop_nav", "formation"}
    entry = index["coop_nav"]
    assert [len(entry[t]) for t in ("medium", "medium-replay", "expert", "other")] == [1, 5, 2, 0]
    files = {each["file"] for tier in entry.values() for each in tier}
    assert {path.name for path in tmp_path.iterdir()} == files | {"index.json"}
    sided = [each["sha256"] for each in entry["mixed-conventions"]]
    assert sided == [each["sha256"] for each in entry["expert"]]
    replays = entry["medium-replay"]
    frames = [each["frames"] for each in replays]
    assert frames == sorted(frames)
    assert max(frames) < entry["medium"][0]["frames"] == 160
    assert sum(each["share"] for each in replays) == pytest.approx(1)
    noise = [each["noise"] for each in replays]
    assert 0.1 < min(noise) < max(noise) <= 0.5
    assert noise == sorted(noise, reverse=True)
    assert 0 <= entry["expert"][0]["figures"]["exact_error"] < 0.02


@pytest.fixture(scope="module")
def sides(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A short run for each side of `tag`, of which each seed solves half of its first episodes."""
    folder = tmp_path_factory.mktemp("sides")
    for name, side in side_specs(TAG).items():
        run = describe_run(
            "mappo", replace(SMALL, frame="auto"), side, (0, 1), n_checkpoints=10, n_episodes=2
        )
        train_run(run, folder / name, opponents="scripted")
        pretend(folder / name, {})
    return {name: folder / name for name in side_specs(TAG)}


@pytest.mark.slow
@pytest.mark.usefixtures("half")
def test_runs_of_both_sides_are_shipped_together(
    sides: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mediums = [Seed(folder, seed) for folder in sides.values() for seed in (0, 1)]
    with pytest.raises(BuildError, match="the tier medium has no policies for evader of tag"):
        ship(mediums[:2], [], [], "tag", TAG, tmp_path)
    assert not (tmp_path / "index.json").exists()
    ship(mediums, mediums[1:3], [], "tag", TAG, tmp_path)
    entry = json.loads((tmp_path / "index.json").read_text())["tag"]
    played = [(each["side"], each["policy"]) for each in entry["medium"]]
    assert played == [("pursuers", 0), ("pursuers", 1), ("evader", 0), ("evader", 1)]
    assert [each["file"] for each in entry["expert"]] == [
        "tag-pursuers-expert-0.safetensors", "tag-evader-expert-0.safetensors",
    ]  # fmt: skip
    monkeypatch.setattr("swarmdata.registry.recipes.checkpoint_index", lambda: {"tag": entry})
    checkpoints.cache_clear()
    for tier, count in (("medium", 4), ("expert", 1), ("medium-replay", 10)):
        teams = sources("tag", tier)
        assert len({each.checkpoint for team in teams for each in team.acting}) == (
            len(entry[tier])
        )
        assert len(teams) == count
        assert all("pursuers" in str(team.checkpoint) for team in teams)
    replay = sources("tag", "medium-replay")
    parts = [[str(each.checkpoint)[-13] for each in team.acting] for team in replay]
    assert all(pursuer == evader for pursuer, evader in parts)  # of equal progress
    checkpoints.cache_clear()


@pytest.mark.usefixtures("half")
def test_an_unfinished_run_is_no_expert(tmp_path: Path) -> None:
    folder = train_run(
        describe_run("mappo", SMALL, SPEC, (0,), n_checkpoints=4, n_episodes=2), tmp_path / "run"
    )
    last_policy_path(folder, 0).unlink()
    with pytest.raises(BuildError, match="run its command again"):
        ship([], [Seed(folder, 0)], [], "coop_nav", SPEC, tmp_path / "shipped")
