"""Runs: resuming is exact, folders are checked, files say what happened."""

import csv
import json
import shutil
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from swarmdata.errors import CheckpointError, DivergedError, SchemaError, UnknownNameError
from swarmdata.interfaces import Policy, fields_of
from swarmdata.learn.policies.choice_policy import ChoicePolicy, RecurrentChoicePolicy
from swarmdata.learn.policies.drawn_policy import FlowPolicy, LatentPolicy
from swarmdata.learn.policies.recurrent_policy import RecurrentPolicy
from swarmdata.learn.policies.sequence_policy import SequencePolicy
from swarmdata.learn.policies.torch_policy import TorchPolicy
from swarmdata.learn.training import run as run_module
from swarmdata.learn.training.checkpoint import load_checkpoint, save_checkpoint
from swarmdata.learn.training.compact import compact, is_same
from swarmdata.learn.training.run_files import CHECKPOINT, CONFIG, CURVE, LOSSES
from swarmdata.learn.training.run_folder import kept_updates, load_run
from swarmdata.learn.training.trainer import Schedule, train_seeds
from swarmdata.registry.components import OFFLINE_ALGORITHMS, resolve
from swarmdata.types import Batch
from tests.support.made_episodes import made_episode
from tests.support.memory_dataset import MemoryDataset
from tests.support.pairs import slow

SEEDS = (5, 2)
SCHEDULE = Schedule(log_every=5, checkpoint_every=10, evaluate_every=20)
SMALL: dict[str, Any] = {
    **dict.fromkeys(("hidden", "actor_hidden", "critic_hidden", "flow_hidden"), (8,)),
    "value_hidden": (8,), "width": 8, "mixer_hidden": 4, "mixer_embedding": 4, "n_samples": 2,
    "burn_in": 2, "window": 4, "fraction": 0.5,
}  # fmt: skip
"""Of the algorithms that have them."""


def dataset() -> MemoryDataset:
    rng = np.random.default_rng(0)
    episodes = [
        made_episode(
            rng.normal(size=(10, 2, 5)), rng.normal(size=(10, 6)), rng.uniform(-1, 1, (9, 2, 2)),
            rng.normal(size=(9, 2)), ends=True, seed=number,
        )
        for number in range(6)
    ]  # fmt: skip
    return MemoryDataset(episodes)


def config_of(algorithm: str, **changes: Any) -> Any:
    kind = resolve("algorithm", OFFLINE_ALGORITHMS, algorithm).Config
    small = {each.name: SMALL[each.name] for each in fields(kind) if each.name in SMALL}
    return kind(**{"n_updates": 43, "batch_size": 8, **small, **changes})


def size_of_first_layer(policy: Policy) -> Mapping[str, float]:
    assert isinstance(
        policy, TorchPolicy | ChoicePolicy | FlowPolicy | LatentPolicy | SequencePolicy
    )
    return {"norm": float(policy.layers[0].weight.norm()), "count": 1.0}


def run(algorithm: str, folder: Path, **options: Any) -> list[Policy]:
    settings: dict[str, Any] = {
        "seeds": SEEDS,
        "config": config_of(algorithm),
        "schedule": SCHEDULE,
        "evaluate": size_of_first_layer,
        "progress": False,
    }
    return train_seeds(algorithm, dataset(), folder, **{**settings, **options})


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a finished run of `bc`, which no test changes."""
    folder = tmp_path_factory.mktemp("done") / "bc"
    run("bc", folder)
    return folder


@pytest.fixture
def finished(done: Path, tmp_path: Path) -> Path:
    """A copy of it."""
    return Path(shutil.copytree(done, tmp_path / "finished"))


def assert_same_files(one: Path, two: Path) -> None:
    for name in (CONFIG, LOSSES, CURVE, CHECKPOINT):
        assert (one / name).read_bytes() == (two / name).read_bytes(), name


MEMORY = {"memory": "gru", "memory_size": 4, "burn_in": 2, "window": 4}
QUICK = {("bc", 3), ("oryx", 10), ("maddpg_bc", 27), ("bc", 15)}
RESUMED = [
    pytest.param(name, stop, changes, marks=[] if (name, stop) in QUICK else [pytest.mark.slow])
    for stop, changes in ((3, {}), (10, {}), (27, {}), (15, MEMORY))
    for name in (OFFLINE_ALGORITHMS if not changes else ("bc", "filtered_bc", "iql", "vdn", "qmix"))
]
"""Before, at and after a checkpoint, and with a memory; the contract resumes every algorithm."""


@pytest.mark.parametrize(("algorithm", "stop", "changes"), RESUMED)
def test_a_stopped_and_resumed_run_equals_an_unbroken_one(
    algorithm: str,
    stop: int,
    changes: dict[str, Any],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    whole, broken = tmp_path / "whole", tmp_path / "broken"
    config = config_of(algorithm, n_updates=31, **changes)
    evaluate = size_of_first_layer if not changes else lambda policy: {"norm": 1.0}
    policies = run(algorithm, whole, config=config, evaluate=evaluate)
    kind = resolve("algorithm", OFFLINE_ALGORITHMS, algorithm)
    update = kind.update

    def interrupted(self: Any, batch: Any) -> Any:
        if self.n_updates == stop:
            raise KeyboardInterrupt
        return update(self, batch)

    with monkeypatch.context() as patch:
        patch.setattr(kind, "update", interrupted)
        with pytest.raises(KeyboardInterrupt):
            run(algorithm, broken, config=config, evaluate=evaluate)
    assert "run the same command again" in capsys.readouterr().err
    run(algorithm, broken, config=config, evaluate=evaluate)
    assert_same_files(whole, broken)
    if changes:
        compact(broken)
        for policy, kept in zip(policies, load_run(broken), strict=True):
            assert is_same(policy, kept)
            assert type(policy) in (RecurrentPolicy, RecurrentChoicePolicy)


def test_a_run_killed_between_the_files_of_a_checkpoint_keeps_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It went on after a checkpoint that was not among those that it was told to keep."""
    written: list[Path] = []

    def once(path: Path, *content: Any) -> str:
        written.append(path)
        if len(written) == 2:
            raise KeyboardInterrupt
        return save_checkpoint(path, *content)

    with monkeypatch.context() as patch:
        patch.setattr(run_module, "save_checkpoint", once)
        with pytest.raises(KeyboardInterrupt):
            run("bc", tmp_path, keep=True)
    run("bc", tmp_path, keep=True)
    assert kept_updates(tmp_path)[0] == SCHEDULE.checkpoint_every


def test_memories_are_not_compiled(tmp_path: Path) -> None:
    with pytest.raises(SchemaError, match="bc has memory=gru"):
        run("bc", tmp_path, config=config_of("bc", memory="gru"), compile=True)


def test_a_batch_smaller_than_a_segment_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SchemaError, match="batch_size is 8 and window 9"):
        run("bc", tmp_path, config=config_of("bc", memory="gru", window=9))


def test_a_finished_run_is_loaded_not_trained(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = run("bc", tmp_path)
    monkeypatch.delattr(resolve("algorithm", OFFLINE_ALGORITHMS, "bc"), "update")
    for policies in (run("bc", tmp_path), load_run(tmp_path)):
        for one, two in zip(first, policies, strict=True):
            assert size_of_first_layer(one) == size_of_first_layer(two)


def test_checkpoints_of_other_statistics_are_refused_in_one_sentence(finished: Path) -> None:
    tensors, metadata = load_checkpoint(finished / CHECKPOINT)
    del tensors["statistics.own_return_std"]
    save_checkpoint(finished / CHECKPOINT, tensors, metadata)
    with pytest.raises(CheckpointError, match=r"lacks the statistics own_return_std: an older"):
        load_run(finished)


@pytest.mark.parametrize("algorithm", ["bc", *slow("maddpg_bc", "iql", "omiga")])
def test_a_seed_has_the_bits_of_a_lone_run(algorithm: str, tmp_path: Path) -> None:
    both, alone = run(algorithm, tmp_path / "both"), run(algorithm, tmp_path / "alone", seeds=(2,))
    assert is_same(both[1], alone[0])
    assert not is_same(both[0], alone[0])


def test_a_run_of_retired_settings_acts_and_does_not_go_on(tmp_path: Path) -> None:
    """Such as `iql` whose weights were factors of its loss: it drew nothing, and had a bound."""
    (policy,) = run("iql", tmp_path, seeds=(0,))
    path = tmp_path / CONFIG
    document = json.loads(path.read_text())
    document["config"]["max_weight"] = 100.0
    del document["config"]["effective_share"]
    path.write_text(json.dumps(document))
    tensors, metadata = load_checkpoint(tmp_path / CHECKPOINT)
    younger = [name for name in tensors if "scored" in name or name == "algorithm.generators"]
    assert len(younger) == 6
    old = {name: tensor for name, tensor in tensors.items() if name not in younger}
    save_checkpoint(tmp_path / CHECKPOINT, old, metadata)
    (loaded,) = load_run(tmp_path)
    assert is_same(loaded, policy)
    with pytest.raises(CheckpointError, match="max_weight"):
        run("iql", tmp_path, seeds=(0,))


def test_files_hold_the_run_its_losses_and_its_curve(tmp_path: Path) -> None:
    run("maddpg_bc", tmp_path)
    document = json.loads((tmp_path / CONFIG).read_text())
    assert document["algorithm"] == "maddpg_bc"
    assert document["config"]["n_updates"] == 43
    assert document["seeds"] == list(SEEDS)
    assert document["spec_hash"] == dataset().spec.hash()
    assert document["versions"]["torch"] == torch.__version__
    with (tmp_path / LOSSES).open() as file:
        losses = list(csv.DictReader(file))
    assert [int(r["update"]) for r in losses[::2]] == [*range(5, 41, 5), 43]
    assert [int(r["seed"]) for r in losses[:2]] == list(SEEDS)
    assert losses[0]["policy_q"] == ""  # the warm start has no value term
    assert float(losses[-1]["extracted_q"]) != 0
    with (tmp_path / CURVE).open() as file:
        curve = list(csv.DictReader(file))
    assert [int(r["update"]) for r in curve[::2]] == [20, 40, 43]
    assert {"norm", "count"} < curve[0].keys()


@pytest.mark.parametrize(
    ("options", "difference"),
    [
        ({"seeds": (5, 3)}, r"seeds\[1\] is 2, not 3"),
        ({"config": config_of("bc", n_updates=44)}, "n_updates is 43, not 44"),
        ({"schedule": Schedule(log_every=10, checkpoint_every=10)}, "log_every is 5, not 10"),
    ],
)
def test_a_folder_of_another_run_is_refused(
    options: dict[str, Any], difference: str, done: Path
) -> None:
    with pytest.raises(CheckpointError, match=difference):
        run("bc", done, **options)


def test_a_checkpoint_of_another_run_is_refused(finished: Path, tmp_path: Path) -> None:
    run("bc", tmp_path / "two", seeds=(1, 2))
    (tmp_path / "two" / CHECKPOINT).replace(finished / CHECKPOINT)
    with pytest.raises(CheckpointError, match="does not belong"):
        run("bc", finished)


def test_a_folder_without_a_run_and_an_unknown_algorithm_are_refused(tmp_path: Path) -> None:
    with pytest.raises(CheckpointError, match="not a run folder"):
        load_run(tmp_path)
    with pytest.raises(UnknownNameError, match="Did you mean 'bc'"):
        train_seeds("bcc", dataset(), tmp_path)


@pytest.mark.parametrize("numbers", [(0, 10, None), (10, 25, None), (5, 10, -1)])
def test_schedules_that_cannot_be_kept_are_refused(numbers: tuple[int, int, int | None]) -> None:
    with pytest.raises(SchemaError, match="expected positive numbers and"):
        Schedule(*numbers)


def test_the_number_of_threads_is_given_back(tmp_path: Path) -> None:
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        run("bc", tmp_path)
        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(before)


def test_training_that_diverges_stops_and_keeps_the_last_good_checkpoint(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Row 64: with the update and the loss; what is on the disk is of before."""
    kind = resolve("algorithm", OFFLINE_ALGORITHMS, "maddpg_bc")
    update = kind.update

    def poisoned(self: Any, batch: Any) -> Any:
        losses = update(self, batch)
        if self.n_updates == 24:
            losses = {name: loss.clone().index_fill_(0, torch.tensor([1]), torch.nan)
                      for name, loss in losses.items()}  # fmt: skip
        return losses

    with monkeypatch.context() as patch:
        patch.setattr(kind, "update", poisoned)
        with pytest.raises(
            DivergedError, match=rf"at 25, of the losses of seed {SEEDS[1]}, .* nan"
        ):
            run("maddpg_bc", tmp_path / "d")
    assert load_checkpoint(tmp_path / "d" / CHECKPOINT)[1]["update"] == 20
    assert "nan" not in (tmp_path / "d" / LOSSES).read_text()
    run("maddpg_bc", tmp_path / "d")
    run("maddpg_bc", tmp_path / "whole")
    assert_same_files(tmp_path / "d", tmp_path / "whole")


def test_batches_hold_what_the_algorithm_declares(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without a declaration they hold everything, and the training is the same."""
    kind = resolve("algorithm", OFFLINE_ALGORITHMS, "bc")
    seen: list[set[str]] = []
    update = kind.update

    def watched(self: Any, batch: Batch) -> Any:
        seen.append({f.name for f in fields(batch) if getattr(batch, f.name) is not None})
        return update(self, batch)

    monkeypatch.setattr(kind, "update", watched)
    run("bc", tmp_path / "declared")
    assert all(names == {"observations", "actions", "mask"} for names in seen)
    seen.clear()
    monkeypatch.delattr(kind, "FIELDS")
    run("bc", tmp_path / "all")
    assert_same_files(tmp_path / "all", tmp_path / "declared")
    recorded = {f.name for f in fields(Batch)} - {"alive", "next_alive", "agent_terminations"}
    assert all(names == recorded for names in seen)


def test_declared_fields_are_those_of_a_batch_and_of_the_class_itself() -> None:
    kind = resolve("algorithm", OFFLINE_ALGORITHMS, "bc")
    assert fields_of(kind) == frozenset({"observations", "actions"})
    assert fields_of(type("Derived", (kind,), {})) is None  # it may read more
    with pytest.raises(UnknownNameError, match="observation"):
        fields_of(type("Misspelt", (), {"FIELDS": ("observation",)}))


def test_a_learning_rate_that_is_far_too_large_is_an_error(tmp_path: Path) -> None:
    """Row 64: for real, and no checkpoint ever holds what is not finite."""
    config = config_of("bc", learning_rate=1e38)
    with pytest.raises(DivergedError, match="a smaller learning_rate"):
        run("bc", tmp_path / "d", config=config)
    assert not (tmp_path / "d" / CHECKPOINT).exists()


def test_tensors_that_are_not_finite_are_never_saved(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Row 64: though the losses of the window were."""
    kind = resolve("algorithm", OFFLINE_ALGORITHMS, "bc")
    state_dict = kind.state_dict

    def poisoned(self: Any) -> Any:
        state = dict(state_dict(self))
        name = next(n for n, v in state.items() if torch.is_tensor(v) and v.is_floating_point())
        return {**state, name: torch.full_like(state[name], torch.inf)}

    monkeypatch.setattr(kind, "state_dict", poisoned)
    with pytest.raises(DivergedError, match=r"of the algorithm's tensors, .* not finite in"):
        run("bc", tmp_path / "d")
    assert not (tmp_path / "d" / CHECKPOINT).exists()
