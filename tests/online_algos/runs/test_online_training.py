"""Online runs: whatever interrupts them, they end as a whole one."""

import os
import shutil
import signal
import subprocess
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from swarmdata.errors import CheckpointError, DivergedError, SwarmdataError
from swarmdata.interfaces import VecEnv
from swarmdata.learn.policies.policy_file import load_policy
from swarmdata.learn.training.checkpoint import load_checkpoint, save_checkpoint
from swarmdata.learn.training.run_files import CHECKPOINT, last_policy_path, policy_path, read_table
from swarmdata.numerics.random import evaluation_seeds
from swarmdata.online_algos.imitation.teacher_cloning import CloneConfig
from swarmdata.online_algos.mappo import MAPPO, MAPPOConfig
from swarmdata.online_algos.ppo import initial_weights
from swarmdata.online_algos.ppo.initial_weights import StartConfig
from swarmdata.online_algos.runs import online_training
from swarmdata.online_algos.runs.online_training import OnlineRun, describe_run, train_run
from swarmdata.online_algos.shaping.shaped_env import ShapingConfig
from swarmdata.online_algos.vdn import VDNConfig
from swarmdata.registry.components import make_env
from swarmdata.specs.task_spec import TaskSpec
from tests.support.pairs import slow

SPEC = TaskSpec(horizon=20)
SMALL = MAPPOConfig(n_steps=320, n_copies=4, rollout_steps=8, hidden=8, minibatch=64)
REPLAYING = VDNConfig(
    n_steps=320, n_copies=4, rollout_steps=8, batch_size=4, capacity=64, margin=128, hidden=(8,)
)
RUN = describe_run("mappo", SMALL, SPEC, (0, 3), n_checkpoints=4, n_episodes=2)
SAME = ("config.json", "curve.csv", "checkpoint.safetensors")


def assert_same_run(ours: Path, theirs: Path) -> None:
    for name in SAME:
        assert (ours / name).read_bytes() == (theirs / name).read_bytes(), name
    for seed in RUN.seeds:
        mine, other = last_policy_path(ours, seed), last_policy_path(theirs, seed)
        assert mine.name == other.name
        assert mine.read_bytes() == other.read_bytes()


def interrupt(*args: Any) -> None:
    raise KeyboardInterrupt


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The run that nothing interrupted."""
    return train_run(RUN, tmp_path_factory.mktemp("whole") / "run")


@pytest.mark.parametrize("has_old_checkpoint", [True, *slow(False)])
def test_an_interrupted_run_ends_as_an_uninterrupted_one(
    has_old_checkpoint: bool, whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also one whose checkpoint has the form of version 0.2."""
    measure, calls = online_training.measure, []

    def fourth(*args: Any) -> dict[str, float]:
        calls.append(args)
        if len(calls) == 4:
            interrupt()
        return measure(*args)

    with monkeypatch.context() as patch:
        patch.setattr(online_training, "measure", fourth)
        with pytest.raises(KeyboardInterrupt):
            train_run(RUN, tmp_path)
    if has_old_checkpoint:
        tensors, metadata = load_checkpoint(tmp_path / CHECKPOINT)
        old = {name.removeprefix("algorithm."): tensor for name, tensor in tensors.items()}
        save_checkpoint(tmp_path / CHECKPOINT, old, {"frames": metadata["frames"]})
    train_run(RUN, tmp_path)
    assert_same_run(whole, tmp_path)


@pytest.mark.slow
def test_threads_do_not_change_a_run(
    whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    used = []

    def note(spec: TaskSpec, n_copies: int, n_threads: int = 1) -> VecEnv:
        used.append(n_threads)
        return make_env(spec, n_copies, n_threads=n_threads)

    monkeypatch.setattr(online_training, "make_env", note)  # where robots learn
    monkeypatch.setattr("swarmdata.rollouts.evaluate.make_env", note)  # where they are measured
    assert_same_run(whole, train_run(RUN, tmp_path / "threads", n_threads=2))
    assert used == [2] * (1 + 4 * 2)


@pytest.mark.slow
def test_a_run_that_is_interrupted_after_its_clone_does_not_clone_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        initial_weights, "CloneConfig", partial(CloneConfig, rollout_steps=8, minibatch=64)
    )
    config = replace(SMALL, start=StartConfig(teacher="straight", clone_rounds=2))
    run = describe_run("mappo", config, SPEC, RUN.seeds, n_checkpoints=4, n_episodes=2)
    undisturbed = train_run(run, tmp_path / "whole")

    with monkeypatch.context() as patch:
        patch.setattr(MAPPO, "update", interrupt)
        with pytest.raises(KeyboardInterrupt):
            train_run(run, tmp_path / "cut")
    monkeypatch.setattr(initial_weights, "clone_teacher", interrupt)
    train_run(run, tmp_path / "cut")
    assert_same_run(undisturbed, tmp_path / "cut")


PROGRAM = """
import sys
from pathlib import Path
from swarmdata.online_algos.runs.online_training import OnlineRun, train_run
train_run(OnlineRun.from_text(sys.argv[1]), Path(sys.argv[2]))
"""


@pytest.mark.slow
def test_a_killed_run_ends_as_a_whole_one(whole: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut"
    for n_checkpoints in (1, 2):
        command = [sys.executable, "-c", PROGRAM, RUN.to_json(), str(cut)]
        process = subprocess.Popen(command)
        while process.poll() is None:
            if len(list(cut.glob("policies/seed-3/*"))) >= n_checkpoints:
                os.kill(process.pid, signal.SIGKILL)  # while it measures or saves the rest
                process.wait(300)
        assert process.returncode == -signal.SIGKILL, "it ended before it could be killed"
    train_run(RUN, cut)
    assert_same_run(whole, cut)


def test_a_run_folder_holds_what_it_promises(whole: Path) -> None:
    assert OnlineRun.from_file(whole / "config.json") == RUN
    rows = (whole / "curve.csv").read_text().splitlines()
    assert rows[0].startswith("frames,seed,success,clean_success,return")
    assert [row.split(",")[:2] for row in rows[1:3]] == [["96", "0"], ["96", "3"]]
    assert len(rows) == 1 + 4 * 2
    assert len((whole / "speed.csv").read_text().splitlines()) == 1 + 4
    events = list((whole / "tensorboard" / "seed-3").glob("events.out.tfevents.*"))
    assert len(events) == 1
    assert events[0].stat().st_size > 200
    step = make_env(SPEC, 2).reset(evaluation_seeds(2))
    actions = load_policy(policy_path(whole, 3, 96)).act(step)
    assert actions.shape == (2, 4, 2)


OTHER = describe_run("mappo", SMALL, SPEC, (0, 4), n_checkpoints=4, n_episodes=2)


def test_another_run_does_not_go_on_in_its_folder(
    whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(MAPPO, "prepare", interrupt)
    with pytest.raises(KeyboardInterrupt):
        train_run(RUN, tmp_path)
    for folder in (whole, tmp_path):  # with a checkpoint, and before the first
        with pytest.raises(CheckpointError, match="differs in: seeds"):
            train_run(OTHER, folder)
    shutil.copy(whole / CHECKPOINT, tmp_path / CHECKPOINT)
    (tmp_path / "config.json").write_text(OTHER.to_json())
    with pytest.raises(CheckpointError, match="does not belong"):
        train_run(OTHER, tmp_path)


WRONG = ("proximty=2",)
CANNOT_BEGIN: tuple[tuple[str, Any, str], ...] = (
    ("mappo", replace(SMALL, shaping=ShapingConfig(payload_path_weight=1.0)), "coop_nav has none"),
    ("mappo", replace(SMALL, start=StartConfig(teacher="straigt")), "Did you mean 'straight'"),
    ("mappo", replace(SMALL, shaping=ShapingConfig(reward_weights=WRONG)), "proximty"),
    ("vdn", VDNConfig(n_steps=320, n_copies=4, hidden=(8,), reward_weights=WRONG), "proximty"),
    ("mappo", replace(SMALL, n_steps=8), "expected at least the 32 of one rollout"),
    ("vdn", replace(REPLAYING, margin=100), "margin is 100, expected at least 112"),
)


@pytest.mark.parametrize(("algorithm", "config", "message"), CANNOT_BEGIN)
def test_a_run_that_cannot_begin_leaves_no_folder(
    tmp_path: Path, algorithm: str, config: Any, message: str
) -> None:
    """Even where its worlds are made after the folder and the replay in it."""
    run = describe_run(algorithm, config, SPEC, (0,), n_checkpoints=4, n_episodes=2)
    with pytest.raises(SwarmdataError, match=message):
        train_run(run, tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_losses_that_are_not_defined_yet_stay_empty(tmp_path: Path) -> None:
    config = replace(SMALL, critic_warmup_fraction=1.0)
    folder = train_run(
        describe_run("mappo", config, SPEC, (0,), n_checkpoints=2, n_episodes=2), tmp_path
    )
    rows = read_table(folder / "curve.csv")
    assert len(rows) == 2
    for row in rows:
        assert "policy" not in row
        assert row["value"] > 0


def test_a_finished_run_keeps_no_replay_and_is_left_as_it_is(tmp_path: Path) -> None:
    run = describe_run("vdn", REPLAYING, SPEC, (0,), n_checkpoints=4, n_episodes=2)
    folder = train_run(run, tmp_path / "run")
    files = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    assert "replay" not in {path.parent.name for path in files}
    (folder / "replay").mkdir()  # as a kill right after the last checkpoint leaves it
    train_run(run, folder)
    assert {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == files
    assert not (folder / "replay").exists()


@pytest.mark.slow
def test_an_online_run_that_diverges_stops_and_keeps_its_checkpoint(
    whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Row 64: with the joint steps; what was saved before goes on to the same end."""
    update = MAPPO.update

    def poisoned(self: Any) -> Any:
        losses = update(self)
        if self.frames >= 200:
            state = self.state_dict()
            name = next(n for n, v in state.items() if v.is_floating_point() and v.ndim > 1)
            self.load_state_dict({**state, name: state[name] * float("nan")})
        return losses

    with monkeypatch.context() as patch:
        patch.setattr(MAPPO, "update", poisoned)
        with pytest.raises(DivergedError, match=r"training diverged in .* not finite in"):
            train_run(RUN, tmp_path / "cut")
    train_run(RUN, tmp_path / "cut")
    assert_same_run(whole, tmp_path / "cut")
