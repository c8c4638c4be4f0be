"""Online training of one side against opponents."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmdata.errors import CheckpointError, SpecError
from swarmdata.evaluation.results.online_report import write_online_report
from swarmdata.evaluation.results.policy_names import find_target
from swarmdata.evaluation.runs.train import train, train_online
from swarmdata.learn.training.run_files import read_table
from swarmdata.online_algos.dagger import DAggerConfig
from swarmdata.online_algos.imitation.teachers import teacher_of
from swarmdata.online_algos.maddpg import MADDPGConfig
from swarmdata.online_algos.mappo import MAPPOConfig
from swarmdata.online_algos.ppo.rollouts import critic_states
from swarmdata.online_algos.runs import online_training
from swarmdata.online_algos.runs.online_training import describe_run, measure, train_run
from swarmdata.online_algos.vdn import VDNConfig
from swarmdata.registry.components import ONLINE_ALGORITHMS, make_env, make_policy
from swarmdata.registry.presets import preset
from swarmdata.rollouts.evaluate import evaluate
from swarmdata.rollouts.side_env import SideEnv
from swarmdata.specs.origins import SideSpec
from swarmdata.specs.recipe import PolicySource
from swarmdata.specs.state_layout import robots_of
from tests.support.pairs import slow
from tests.support.tiny import make_tiny

TAG = preset("tag").with_updates(horizon=20)
REPLAY: dict[str, Any] = {"batch_size": 4, "capacity": 64, "margin": 128, "frame": "auto"}
COUNTS: dict[str, Any] = {"n_steps": 320, "n_copies": 4, "rollout_steps": 8}
SMALL: dict[str, Any] = {
    "mappo": MAPPOConfig(**COUNTS, hidden=8, minibatch=64, frame="auto"),
    "dagger": DAggerConfig(**COUNTS, hidden=8, minibatch=64, frame="auto"),
    "maddpg": MADDPGConfig(**COUNTS, **REPLAY),
    "vdn": VDNConfig(**COUNTS, **REPLAY, hidden=(8,)),
    "qmix": VDNConfig(**COUNTS, **REPLAY, hidden=(8,)),
}


def side(name: str, opponents: str = "scripted") -> SideSpec:
    return SideSpec(whole=TAG, side=name, opponents=opponents)


def begin(algorithm: str, spec: SideSpec) -> Any:
    config = SMALL[algorithm]
    return describe_run(algorithm, config, spec, (0, 3), n_checkpoints=4, n_episodes=2)


@pytest.mark.parametrize("name", ["evader", *slow("pursuers")])
@pytest.mark.parametrize("algorithm", sorted(ONLINE_ALGORITHMS))
def test_every_algorithm_trains_a_side_and_resumes(
    algorithm: str, name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run, calls = begin(algorithm, side(name)), []
    train_run(run, tmp_path / "whole", opponents="scripted")

    def third(*arguments: Any) -> dict[str, float]:
        calls.append(arguments)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return measure(*arguments)

    with monkeypatch.context() as patch:
        patch.setattr(online_training, "measure", third)
        with pytest.raises(KeyboardInterrupt):
            train_run(run, tmp_path / "cut", opponents="scripted")
    train_run(run, tmp_path / "cut", opponents="scripted")
    for file in ("config.json", "curve.csv", "checkpoint.safetensors"):
        assert (tmp_path / "whole" / file).read_bytes() == (tmp_path / "cut" / file).read_bytes()
    target = find_target(str(tmp_path / "cut"), opponents="scripted")
    assert target.measured == side(name)
    step = make_env(TAG, 2).reset(np.arange(2, dtype=np.uint64))
    target.policies[0].reset(step, np.arange(2))
    assert target.policies[0].act(step).any()


def test_a_teacher_labels_the_robots_of_its_side() -> None:
    env = SideEnv(make_env(TAG, 4), side("evader", "tag-greedy"), "tag-greedy")
    teacher, whole = teacher_of(SMALL["dagger"], env), make_policy("scripted", TAG)
    step = env.reset(np.arange(4, dtype=np.uint64))
    for each in (teacher, whole):
        each.reset(env.whole_step, np.arange(4))
    for _ in range(5):
        expected = whole.act(env.whole_step)[:, 3:]
        actions = teacher.act(step)
        np.testing.assert_array_equal(actions, expected)
        step = env.step(actions)


def test_critics_see_the_robot_of_their_side_first() -> None:
    env = SideEnv(make_env(TAG, 4), side("evader"), "scripted")
    step = env.reset(np.arange(4, dtype=np.uint64))
    views = critic_states(step, 3)
    evader = robots_of(step.states, 4)[:, 3]
    np.testing.assert_array_equal(views[:, 0, :8], evader * np.float32(0.5))
    np.testing.assert_array_equal(np.sort(views[:, 0]), np.sort(step.states * np.float32(0.5)))


def test_curves_are_those_of_the_side(tmp_path: Path) -> None:
    run = begin("dagger", side("evader", "idle"))
    train_run(run, tmp_path / "run", opponents="idle")
    last = read_table(tmp_path / "run" / "curve.csv")[-1]
    found = find_target(str(tmp_path / "run"), opponents="idle")
    again = evaluate(
        found.policies[1], TAG, n_episodes=2, block="validation", side=found.side, progress=False
    )
    assert last["return"] == pytest.approx(again.metrics["return"].mean(), rel=1e-5)
    assert last["success"] == again.metrics["evader_success"].mean()
    assert "| `tag-evader-vs-idle` |" in write_online_report([tmp_path / "run"], tmp_path / "out")


def test_opponents_may_be_a_run_of_the_other_side(tmp_path: Path) -> None:
    few = {"n_steps": "320", "n_copies": "4", "rollout_steps": "8", "hidden": "8", "frame": "auto"}
    options: dict[str, Any] = {"changes": few, "seeds": [0], "n_checkpoints": 1, "progress": False}
    evader, pursuers = tmp_path / "evader", tmp_path / "pursuers"
    train_online("dagger", TAG, evader, side="evader", opponents="scripted", **options)
    train_online("mappo", TAG, pursuers, side="pursuers", opponents=evader, **options)
    found = find_target(str(pursuers), opponents=str(evader))
    assert found.side is not None
    assert str(found.side.opponents).startswith("evader@")
    with pytest.raises(SpecError, match="not trained for another side of tag than evader"):
        train_online("mappo", TAG, tmp_path / "x", side="evader", opponents=evader, **options)
    other = {**options, "changes": {**few, "n_steps": "640"}}
    train_online("dagger", TAG, tmp_path / "next", side="evader", opponents="idle", **other)
    (tmp_path / "evader").rename(tmp_path / "first")
    (tmp_path / "next").rename(tmp_path / "evader")
    with pytest.raises(CheckpointError, match="opponents"):
        train_online("mappo", TAG, pursuers, side="pursuers", opponents=evader, **options)


def test_sides_that_do_not_fit_are_refused(tmp_path: Path) -> None:
    refused: list[tuple[str, Any, dict[str, Any]]] = [
        (r"tag has several sides \(pursuers, evader\), and mappo trains one", TAG, {}),
        ("tag has several sides", TAG, {"side": "evader"}),
        ("tag has several sides", TAG, {"opponents": "scripted"}),
        ("coop_nav has one side", "coop_nav", {"side": "team", "opponents": "scripted"}),
        ("has one side only; leave them out", "coop_nav", {"opponents": "scripted"}),
    ]
    for words, task, arguments in refused:
        with pytest.raises(SpecError, match=words):
            train_online("mappo", task, tmp_path / "x", seeds=[0], progress=False, **arguments)
    with pytest.raises(SpecError, match="needs opponents for the other sides"):
        train_run(begin("mappo", side("evader")), tmp_path / "x")
    assert not (tmp_path / "x").exists()


def test_actors_of_a_side_cannot_avoid_by_themselves(tmp_path: Path) -> None:
    """What keeps robots from contacts decides for all of them."""
    config = SMALL["mappo"]
    first = describe_run("mappo", config, side("evader"), (0,), n_checkpoints=1, n_episodes=2)
    train_run(first, tmp_path / "first", opponents="scripted")
    start = replace(config.start, policies=str(tmp_path / "first"), avoidance=True)
    run = describe_run("mappo", replace(config, start=start), side("evader"), (0,))
    with pytest.raises(SpecError, match=r"start\.avoidance without start\.teacher"):
        train_run(run, tmp_path / "x", opponents="scripted")


@pytest.mark.slow
def test_clones_of_the_ring_catch_the_evader(tmp_path: Path) -> None:
    """The scripted ring captures in 88 % of the episodes, pursuers that drive straight in 4."""
    config = DAggerConfig(n_steps=32_768, frame="auto")
    spec = SideSpec(whole=preset("tag"), side="pursuers", opponents="scripted")
    run = describe_run("dagger", config, spec, (0,), n_checkpoints=1, n_episodes=64)
    train_run(run, tmp_path / "run", opponents="scripted")
    assert read_table(tmp_path / "run" / "curve.csv")[-1]["success"] > 0.5


def test_a_side_continues_an_offline_run_and_mixes_in_its_data(tmp_path: Path) -> None:
    opponent = PolicySource(label="evader", name="random")
    team = (PolicySource(label="a", name="scripted", opponents=(opponent,)),)
    data = make_tiny(tmp_path / "tag-tiny-v0", id="tag-tiny-v0", spec=TAG, policies=team)
    few = {"n_updates": 4, "hidden": "8", "batch_size": 8, "regulariser": "none"}
    for name in ("pursuers", "evader"):
        train("vdn", data, tmp_path / name, side=name, n_seeds=1, changes=few, progress=False)
    changes = {"n_steps": "64", "n_copies": "4", "rollout_steps": "4", "batch_size": "8"}
    options: dict[str, Any] = {
        "side": "pursuers", "opponents": "idle", "data": data, "seeds": [0], "changes": changes,
        "n_checkpoints": 1, "progress": False,
    }  # fmt: skip
    train_online("vdn", TAG, tmp_path / "on", start=tmp_path / "pursuers", **options)
    first, last = read_table(tmp_path / "on" / "curve.csv")
    assert (first["frames"], last["frames"]) == (0, 64)
    with pytest.raises(CheckpointError, match=r"was trained for tag: evader .* differs from this"):
        train_online("vdn", TAG, tmp_path / "x", start=tmp_path / "evader", **options)
