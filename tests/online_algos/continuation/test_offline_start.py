"""Online training that starts from offline runs: equal actions, curves, and wrong combinations."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
import torch

import swarmdata
from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import CheckpointError, DiskFullError, SchemaError, SpecError
from swarmdata.evaluation.runs import train as training
from swarmdata.evaluation.runs.train import train_online
from swarmdata.learn.networks.critics import RobotCritics
from swarmdata.learn.training.compact import compact
from swarmdata.learn.training.run_files import CHECKPOINT, read_table
from swarmdata.learn.training.run_folder import load_run
from swarmdata.learn.training.settings import override
from swarmdata.learn.training.trainer import train_seeds
from swarmdata.online_algos.continuation.offline_start import read_start
from swarmdata.online_algos.dagger import DAggerConfig
from swarmdata.online_algos.maddpg import MADDPG, MADDPGConfig
from swarmdata.online_algos.runs import online_training
from swarmdata.online_algos.runs.online_training import measure, read_online_run
from swarmdata.perception.observer import features_of
from swarmdata.registry.components import (
    OFFLINE_ALGORITHMS,
    ONLINE_ALGORITHMS,
    make_env,
    make_task,
    resolve,
)
from swarmdata.rollouts.function_policy import frame_of
from swarmdata.specs.task_spec import TaskSpec
from tests.support.own_task import nothing_registered
from tests.support.pairs import slow
from tests.support.tiny import TINY

SEEDS = (0, 1)
OFFLINE: dict[str, dict[str, str]] = {
    "bc": {"hidden": "12,12"},
    "maddpg_bc": {"actor_hidden": "12", "critic_hidden": "8"},
    "vdn": {"hidden": "12,12", "regulariser": "cql", "n_bins": "5"},
    "qmix": {"hidden": "12,12", "regulariser": "none", "n_bins": "5"},
    "bc-clip": {"hidden": "12,12", "output": "clip"},
    "vdn-bc": {"hidden": "12,12"},
}
PAIRS = (
    ("maddpg", "bc"),
    ("maddpg", "maddpg_bc"),
    ("mappo", "bc-clip"),
    ("dagger", "bc-clip"),
    ("vdn", "vdn"),
    ("vdn", "qmix"),
    ("qmix", "qmix"),
)
SMALL = {"n_steps": "160", "n_copies": "4", "rollout_steps": "8"}
REPLAY = {"batch_size": "8", "capacity": "200", "margin": "200", "warmup_transitions": "16"}


class Mine:
    """What a user's online algorithm has at least."""

    Config = DAggerConfig
    LOSSES = ("error",)


def small(algorithm: str) -> dict[str, str]:
    own = {"minibatch": "64"} if algorithm in ("mappo", "dagger") else REPLAY
    return {**SMALL, **own, **({"critic_hidden": "8"} if algorithm == "maddpg" else {})}


@pytest.fixture(scope="module")
def task(tmp_path_factory: pytest.TempPathFactory) -> str:
    file = tmp_path_factory.mktemp("task") / "tiny.yaml"
    file.write_text(TINY.spec.to_yaml())
    return str(file)


@pytest.fixture(scope="module")
def runs(tiny: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A run of each offline algorithm, of a few updates."""
    data, folder = Dataset.open(tiny), tmp_path_factory.mktemp("runs")
    return {
        name: trained(name.split("-")[0], data, folder / name, changes)
        for name, changes in OFFLINE.items()
    }


def trained(algorithm: str, data: Dataset, folder: Path, changes: Mapping[str, str]) -> Path:
    """An offline run of a few updates."""
    kind = resolve("algorithm", OFFLINE_ALGORITHMS, algorithm)
    config = override(kind.Config(), {"n_updates": "6", "batch_size": "16", **changes})
    train_seeds(
        algorithm, data, folder, seeds=SEEDS, config=config, frame=frame_of(data.spec),
        progress=False,
    )  # fmt: skip
    return folder


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two checkpoints of two episodes."""
    describe = online_training.describe_run

    def shorter(*arguments: Any, **options: Any) -> Any:
        return describe(*arguments, **{**options, "n_checkpoints": 2, "n_episodes": 2})

    monkeypatch.setattr(training, "describe_run", shorter)


def start(algorithm: str, task: str, out: Path, run: Path, **options: Any) -> None:
    changes = {**small(algorithm), **options.pop("changes", {})}
    train_online(
        algorithm, task, out, seeds=SEEDS, changes=changes, start=run, progress=False, **options
    )


def test_a_start_that_a_full_disk_interrupts_goes_on_in_its_folder(
    runs: dict[str, Path], task: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Tables were left without the `config.json` that makes the folder a run's."""

    def full(*arguments: Any) -> dict[str, float]:
        raise DiskFullError("no space was left")

    with monkeypatch.context() as patch:
        patch.setattr(online_training, "measure", full)
        with pytest.raises(DiskFullError):
            start("maddpg", task, tmp_path / "run", runs["bc"])
    start("maddpg", task, tmp_path / "run", runs["bc"])
    rows = read_table(tmp_path / "run" / "curve.csv")
    assert [row["frames"] for row in rows][:2] == [0, 0]


@pytest.mark.parametrize(("algorithm", "offline"), PAIRS)
def test_they_act_alike_bit_for_bit(
    algorithm: str, offline: str, runs: dict[str, Path], tmp_path: Path
) -> None:
    """For seeds in another order, too."""
    kind, begin = resolve("algorithm", ONLINE_ALGORITHMS, algorithm), read_start(runs[offline])
    settings = kind.settings_of(begin, features_of(make_task(TINY.spec)))
    config = override(kind.Config(), {**settings, **small(algorithm)})
    run = kind(make_env(TINY.spec, 2 * config.n_copies), SEEDS[::-1], config, tmp_path)
    run.start_from(begin)
    step = make_env(TINY.spec, 16).reset(np.arange(16, dtype=np.uint64))
    expected = load_run(runs[offline])
    for index, seed in enumerate(SEEDS[::-1]):
        np.testing.assert_array_equal(run.policy(index).act(step), expected[seed].act(step))
    ours, theirs = (p.act(step) for p in (expected[0], expected[1]))
    assert not np.array_equal(ours, theirs)


@pytest.mark.slow
@pytest.mark.parametrize("algorithm", ["maddpg", *slow("qmix")])
def test_a_killed_run_that_started_and_mixes_data_ends_as_a_whole_one(
    algorithm: str, runs: dict[str, Path], task: str, tiny: Path, tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    offline = runs["bc" if algorithm == "maddpg" else "qmix"]
    options = {"data": str(tiny), "offline_share": 0.25}
    start(algorithm, task, tmp_path / "whole", offline, **options)
    calls = []

    def interrupt(*arguments: Any) -> dict[str, float]:
        calls.append(arguments)
        if len(calls) in (2, 6):  # while it measures the start, and in the last checkpoint
            raise KeyboardInterrupt
        return measure(*arguments)

    with monkeypatch.context() as patch:
        patch.setattr(online_training, "measure", interrupt)
        for _ in range(2):
            with pytest.raises(KeyboardInterrupt):
                start(algorithm, task, tmp_path / "cut", offline, **options)
    start(algorithm, task, tmp_path / "cut", offline, **options)
    for name in ("config.json", "curve.csv", CHECKPOINT):
        whole, cut = (tmp_path / each / name for each in ("whole", "cut"))
        assert whole.read_bytes() == cut.read_bytes(), name
    recorded = read_online_run(tmp_path / "whole").recorded
    assert recorded is not None
    assert (recorded.share, recorded.id) == (0.25, TINY.id)


def test_a_batch_has_its_share_of_recorded_rows(
    runs: dict[str, Path], tiny: Path, tmp_path: Path
) -> None:
    kind = resolve("algorithm", ONLINE_ALGORITHMS, "maddpg")
    config = override(kind.Config(), small("maddpg"))
    run = kind(make_env(TINY.spec, config.n_copies), (0,), config, tmp_path)
    data = Dataset.open(tiny)
    run.mix_in(data, 0.25)
    run.update()
    batch = run.draw()
    assert len(batch.actions[0]) == 8
    rows = data.transitions()["rewards"]
    known = [bool((rows == reward.numpy()).all(-1).any()) for reward in batch.rewards[0]]
    assert known[-2:] == [True, True]
    assert not all(known[:-2])


WRONG = [
    ("maddpg", "vdn", {}, "expected perceptrons whose actions pass through tanh"),
    ("maddpg", "bc-clip", {}, "expected perceptrons whose actions pass through tanh"),
    ("mappo", "bc", {}, "bc with --set output=clip"),
    ("vdn", "bc", {}, "--regulariser none or cql"),
    ("vdn", "vdn-bc", {}, "--regulariser none or cql"),
    ("maddpg", "bc", {"frame": "world"}, "have the frame Frame"),
    ("maddpg", "bc", {"actor_hidden": "9"}, "have weights of shapes"),
    ("vdn", "vdn", {"n_bins": "7"}, "have weights of shapes"),
]


@pytest.mark.parametrize(("algorithm", "offline", "changes", "message"), WRONG)
def test_what_does_not_fit_is_refused(
    algorithm: str, offline: str, changes: dict[str, str], message: str,
    runs: dict[str, Path], task: str, tmp_path: Path,
) -> None:  # fmt: skip
    with pytest.raises(CheckpointError, match=message):
        start(algorithm, task, tmp_path / "run", runs[offline], changes=changes)


def test_another_task_and_other_seeds_are_refused(
    runs: dict[str, Path], task: str, tiny: Path, tmp_path: Path
) -> None:
    other = tmp_path / "other.yaml"
    other.write_text(TaskSpec(horizon=30).to_yaml())
    with pytest.raises(CheckpointError, match="differs from this task in: horizon"):
        start("maddpg", str(other), tmp_path / "run", runs["bc"])
    with pytest.raises(SchemaError, match="with another spec: it differs in horizon"):
        train_online("maddpg", str(other), tmp_path / "run", data=str(tiny))
    with pytest.raises(CheckpointError, match="has the seeds 0, 1, expected seed 2"):
        train_online(
            "maddpg", task, tmp_path / "run", seeds=(1, 2), changes=small("maddpg"),
            start=runs["bc"], progress=False,
        )  # fmt: skip


def test_an_algorithm_of_a_user_that_takes_nothing_over_cannot_start(
    runs: dict[str, Path], task: str, tmp_path: Path
) -> None:
    with nothing_registered():
        swarmdata.register_algorithm("mine", Mine, online=True)
        with pytest.raises(SchemaError, match="Mine cannot start from an offline run"):
            train_online("mine", task, tmp_path / "run", start=runs["bc"], progress=False)


def test_data_need_a_replay_and_a_share(task: str, tiny: Path, tmp_path: Path) -> None:
    with pytest.raises(SchemaError, match="mappo has no replay of transitions"):
        train_online("mappo", task, tmp_path / "run", data=str(tiny))
    with pytest.raises(SpecError, match="the offline share is 1, expected above 0 and below 1"):
        train_online("vdn", task, tmp_path / "run", data=str(tiny), offline_share=1.0)


def test_online_runs_are_no_offline_runs(runs: dict[str, Path], task: str, tmp_path: Path) -> None:
    start("maddpg", task, tmp_path / "run", runs["bc"])
    with pytest.raises(CheckpointError, match="is a run of online training"):
        read_start(tmp_path / "run")


Offline = Callable[..., Path]


@pytest.fixture
def offline(tiny: Path, tmp_path: Path) -> Offline:
    """Trains an offline actor-critic, or `bc`, of a few updates."""

    def train(algorithm: str, rewards: Mapping[str, float] | None = None, **changes: str) -> Path:
        sizes = {} if algorithm == "bc" else {"critic_hidden": "8", "actor_hidden": "12"}
        data = Dataset.open(tiny).with_rewards(**rewards or {})
        return trained(algorithm, data, tmp_path / algorithm, {**sizes, **changes})

    return train


def started(run: Path, folder: Path, **changes: str) -> tuple[MADDPG, list[str]]:
    """Online training that began with a run, its seeds in another order; and what it said."""
    begin = read_start(run)
    settings = MADDPG.settings_of(begin, features_of(make_task(TINY.spec)))
    config = override(MADDPGConfig(), {**settings, **SMALL, **REPLAY, **changes})
    assert isinstance(config, MADDPGConfig)
    online = MADDPG(make_env(TINY.spec, 2 * config.n_copies), SEEDS[::-1], config, folder)
    return online, online.start_from(begin)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("algorithm", "changes"),
    [("maddpg_bc", {"critic": "decentralized"}), ("cfcql", {}), ("iql", {})],
)
def test_robots_have_the_values_of_the_offline_run(
    algorithm: str, changes: dict[str, str], offline: Offline, tmp_path: Path
) -> None:
    """Also those of the slow copies; the statistics that critics see by are those of the run."""
    run = offline(algorithm, **changes)
    begin = read_start(run)
    theirs = cast("RobotCritics", cast("Any", begin.algorithm).critics)
    assert not torch.equal(theirs.online.flat, theirs.target.flat)
    online, sentences = started(run, tmp_path / "replay")
    assert sentences == []
    online.update()
    batch = online.draw()
    online, _ = started(run, tmp_path / "again")
    mine = online.learner.critics
    ours, others = mine.view(batch.states, batch.observations), batch.actions
    seen = theirs.view(batch.states.flip(0), batch.observations.flip(0))
    assert torch.equal(mine.q(ours, others), theirs.q(seen, others.flip(0)).flip(0))
    assert torch.equal(mine.target_q(ours, others), theirs.target_q(seen, others.flip(0)).flip(0))


def test_values_stay_in_the_units_of_the_offline_run(offline: Offline, tmp_path: Path) -> None:
    run = offline("maddpg_bc", discount="0.9")
    online, _ = started(run, tmp_path / "replay")
    config, scale = online.config, 1 / read_start(run).statistics.own_return_std
    assert (config.discount, config.reward_scale) == (0.9, scale)
    assert (config.critic, config.critic_hidden) == ("centralized", (8,))


ANEW = [
    ("bc", {}, {}, "bc has none of each robot"),
    ("omar", {}, {}, "omar has none of each robot"),
    ("maddpg_bc", {"reward": "team"}, {}, "they value the team's reward"),
    ("maddpg_bc", {}, {"critic": "decentralized"}, "Leave out the settings of the critics"),
    ("maddpg_bc", {}, {"critic_hidden": "9"}, "Leave out the settings of the critics"),
    ("maddpg_bc", {}, {"corrections": "none"}, "Leave out the settings of the critics"),
]


@pytest.mark.parametrize(("algorithm", "changes", "online_changes", "reason"), ANEW)
def test_critics_of_other_kinds_begin_anew_and_it_says_why(
    algorithm: str, changes: dict[str, str], online_changes: dict[str, str], reason: str,
    offline: Offline, tmp_path: Path,
) -> None:  # fmt: skip
    online, (sentence,) = started(
        offline(algorithm, **changes), tmp_path / "replay", **online_changes
    )
    assert sentence.startswith("The critics begin anew, not with those of ")
    assert reason in sentence
    online.update()


def test_critics_of_other_rewards_and_of_compact_runs_begin_anew(
    offline: Offline, tmp_path: Path
) -> None:
    run = offline("maddpg_bc", rewards={"robot_collision": 9.0})
    (sentence,) = started(run, tmp_path / "other")[1]
    assert sentence.endswith("they value other weights of rewards than the task's.")
    compact(run)
    (sentence,) = started(run, tmp_path / "compact")[1]
    assert "its checkpoint was made small" in sentence
