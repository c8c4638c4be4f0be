"""Shipping picks the right checkpoints of online runs and writes what recipes need."""

import csv
import json
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
from swarmdata.specs.task_spec import TaskSpec

SPEC = TaskSpec(horizon=20)
SMALL = MAPPOConfig(n_steps=320, n_copies=4, rollout_steps=8, hidden=8, minibatch=64)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short run whose curve pretends to pass the band."""
    folder = tmp_path_factory.mktemp("runs") / "seeds-0-1"
    train_run(describe_run("mappo", SMALL, SPEC, (0, 1), n_checkpoints=10, n_episodes=2), folder)
    with (folder / "curve.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    for row in rows:
        row["success"] = str({"96": 0.1, "160": 0.45, "192": 0.5}.get(row["frames"], 0.9))
    with (folder / "curve.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    return folder


@pytest.fixture
def half(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every policy solves half of its episodes."""
    monkeypatch.setattr(checkpoint_selection, "measure", lambda *_: {"success": 0.5})


def test_the_medium_is_the_first_checkpoint_in_the_band(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    too_near_the_end, inside = {"success": 0.41}, {"success": 0.44}
    figures = iter([too_near_the_end, inside])
    monkeypatch.setattr(checkpoint_selection, "measure", lambda *_: next(figures))
    medium = find_medium(Seed(run, 1), SPEC, tmp_path)
    assert medium is not None
    assert medium.frames == 192
    monkeypatch.setattr(checkpoint_selection, "measure", lambda *_: {"success": 0.7})
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


@pytest.mark.usefixtures("half")
def test_an_unfinished_run_is_no_expert(tmp_path: Path) -> None:
    folder = train_run(
        describe_run("mappo", SMALL, SPEC, (0,), n_checkpoints=4, n_episodes=2), tmp_path / "run"
    )
    last_policy_path(folder, 0).unlink()
    with pytest.raises(BuildError, match="run its command again"):
        ship([], [Seed(folder, 0)], [], "coop_nav", SPEC, tmp_path / "shipped")
