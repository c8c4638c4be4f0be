"""Ranking runs of a tiny dataset: every policy, every criterion, and refusals."""

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("torch", reason="ranking needs the torch extra")

from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import SchemaError, SpecError
from swarmdata.evaluation.policy_selection.rank import rank
from swarmdata.evaluation.policy_selection.ranking_record import Ranking
from swarmdata.evaluation.results.policy_names import find_target
from swarmdata.evaluation.results.target_evaluation import evaluate_target
from swarmdata.evaluation.runs.train import train
from swarmdata.learn.evaluation.fqe import FQEConfig
from swarmdata.learn.training.compact import compact
from swarmdata.learn.training.run_folder import load_algorithm, load_run
from swarmdata.learn.training.trainer import Schedule, train_seeds
from swarmdata.offline_algos.bc import BCConfig
from swarmdata.registry.components import OFFLINE_ALGORITHMS, resolve
from swarmdata.registry.presets import preset
from swarmdata.specs.recipe import PolicySource, Splits
from tests.support.command_line import run as run_command
from tests.support.tiny import make_tiny

SMALL = FQEConfig(n_updates=20, hidden=(8,), batch_size=16)
SETTINGS: dict[str, dict[str, Any]] = {
    "bc": {"hidden": (8,)},
    "maddpg_bc": {"actor_hidden": (8,), "critic_hidden": (8,), "bc_warmup_share": 0.1},
}


class Made:
    """A dataset's folder and two runs of it with two seeds each; the first kept checkpoints."""

    def __init__(self, folder: Path) -> None:
        splits = Splits(block=4)
        self.data = make_tiny(folder / "data", splits=splits)
        self.other = make_tiny(folder / "other", splits=splits, seed=6)
        dataset = Dataset.open(self.data).split("train")
        self.runs = [folder / name for name in SETTINGS]
        for run in self.runs:
            kind = resolve("algorithm", OFFLINE_ALGORITHMS, run.name)
            config = kind.Config(n_updates=20, batch_size=8, **SETTINGS[run.name])
            schedule = Schedule(log_every=10, checkpoint_every=10)
            train_seeds(
                run.name, dataset, run, seeds=(0, 7), config=config, schedule=schedule,
                keep=run.name == "bc", progress=False,
            )  # fmt: skip

    def rank(self, **changes: Any) -> Ranking:
        options = {"dataset_id": str(self.data), "config": SMALL, "progress": False, **changes}
        return rank(options.pop("folders", self.runs), **options)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Made:
    return Made(tmp_path_factory.mktemp("made"))


@pytest.fixture(scope="module")
def ranking(made: Made) -> Ranking:
    """Of both runs, by the default criterion."""
    return made.rank()


@pytest.mark.slow
def test_every_seed_is_ranked_by_every_criterion(made: Made, ranking: Ranking) -> None:
    labels = {policy.label for policy in ranking.policies}
    assert labels == {f"{run}/seed-{seed}@20" for run in SETTINGS for seed in (0, 7)}
    values = [policy.fqe[0] for policy in ranking.policies]
    assert values == sorted(values, reverse=True)
    for policy in ranking.policies:
        assert policy.fqe[1] <= policy.fqe[0] <= policy.fqe[2]
        assert (policy.td_error is None) == (policy.algorithm == "bc")
        assert policy.score is None
        assert len(policy.fqe_curve) == 10
    assert ranking.quality == {}
    assert ranking == made.rank()


@pytest.mark.slow
def test_the_imitation_error_is_that_of_the_validation_split(made: Made, ranking: Ranking) -> None:
    found = {policy.label: policy for policy in ranking.policies}
    held_out = Dataset.open(made.data).split("validation").transitions()
    for policy, seed in zip(load_run(made.runs[0]), (0, 7), strict=True):
        errors = np.square(policy.actions(held_out["observations"]) - held_out["actions"])  # type: ignore[attr-defined]
        row = found[f"bc/seed-{seed}@20"]
        assert row.imitation_error == pytest.approx(errors.mean(), rel=1e-5)
        assert row.weighted_imitation_error != row.imitation_error


@pytest.mark.slow
def test_another_criterion_sorts_and_those_without_it_come_last(made: Made) -> None:
    errors = [policy.td_error for policy in made.rank(by="td_error").policies]
    assert errors[0] is not None
    assert errors[1] is not None
    assert errors[0] <= errors[1]
    assert errors[2:] == [None, None]
    with pytest.raises(SchemaError, match="no policy here has a TD error"):
        made.rank(by="td_error", folders=made.runs[:1])


@pytest.mark.slow
def test_checkpoints_that_were_kept_are_policies_as_well(made: Made) -> None:
    ranking = made.rank(checkpoints=True)
    updates = sorted((policy.run, policy.update) for policy in ranking.policies)
    assert updates == [("bc", 10)] * 2 + [("bc", 20)] * 2 + [("maddpg_bc", 20)] * 2
    errors = {policy.label: policy.imitation_error for policy in ranking.policies}
    assert errors["bc/seed-0@10"] != errors["bc/seed-0@20"]
    assert load_algorithm(made.runs[0], update=10).update == 10


@pytest.mark.slow
def test_a_run_that_was_made_small_has_every_criterion_but_those_of_its_critics(
    made: Made, ranking: Ranking, tmp_path: Path
) -> None:
    small = tmp_path / "maddpg_bc"
    shutil.copytree(made.runs[1], small)
    compact(small)
    found = {policy.seed: policy for policy in made.rank(folders=[small]).policies}
    for whole in (policy for policy in ranking.policies if policy.run == "maddpg_bc"):
        assert whole.td_error is not None
        assert found[whole.seed] == whole.model_copy(update={"td_error": None})


@pytest.mark.slow
def test_runs_of_one_name_are_told_apart(made: Made, tmp_path: Path) -> None:
    copy = tmp_path / "bc"
    shutil.copytree(made.runs[0], copy)
    names = {policy.run for policy in made.rank(folders=[made.runs[0], copy]).policies}
    assert names == {str(made.runs[0]), str(copy)}


@pytest.mark.slow
def test_scores_from_the_simulator_and_from_files_are_the_same(made: Made, tmp_path: Path) -> None:
    simulated = made.rank(n_episodes=2)
    for run in made.runs:
        evaluate_target(find_target(str(run)), 2, tmp_path, progress=False)
    read = made.rank(results=tmp_path)
    assert simulated == read
    assert (read.score_unit, read.n_score_episodes) == ("return", 2)
    assert {name: each.n_policies for name, each in read.quality.items()} == {
        "fqe": 4, "fqe_pessimistic": 4, "imitation_error": 4, "weighted_imitation_error": 4,
        "td_error": 2,
    }  # fmt: skip
    best, chosen = max(p.score for p in read.policies if p.score is not None), read.policies[0]
    assert chosen.score is not None
    assert read.quality["fqe"].regret[1] == pytest.approx(best - chosen.score)


@pytest.mark.slow
def test_results_of_other_policies_are_refused(made: Made, tmp_path: Path) -> None:
    evaluate_target(find_target(str(made.runs[0])), 2, tmp_path, progress=False)
    read = made.rank(results=tmp_path)
    assert {policy.run for policy in read.policies if policy.score is None} == {"maddpg_bc"}
    assert "td_error" not in read.quality
    with pytest.raises(SchemaError, match="holds 2 results, 2 of them in the world"):
        made.rank(results=tmp_path, folders=made.runs[1:])
    with pytest.raises(SchemaError, match="expected one of them"):
        made.rank(results=tmp_path, n_episodes=2)


def test_runs_must_be_of_the_dataset(made: Made, tmp_path: Path) -> None:
    with pytest.raises(SchemaError, match="is not the dataset that"):
        made.rank(dataset_id=str(made.other))
    stranger = tmp_path / "stranger"
    shutil.copytree(made.runs[0], stranger)
    document = json.loads((stranger / "config.json").read_text())
    (stranger / "config.json").write_text(json.dumps({**document, "digest": "0" * 64}))
    with pytest.raises(SchemaError, match="Rank only runs of one dataset and one view"):
        made.rank(folders=[made.runs[0], stranger])
    with pytest.raises(SchemaError, match=r"give the folder of that dataset \(--dataset\)"):
        made.rank(dataset_id=None)


def test_the_command_prints_and_writes(made: Made, tmp_path: Path) -> None:
    settings = ("--set", "n_updates=3", "--set", "hidden=4", "--set", "batch_size=4")
    command = ("rank", *made.runs, "--dataset", made.data, *settings)
    printed = run_command(*command, "--out", tmp_path / "out")
    written = Ranking.from_file(tmp_path / "out" / "ranking.json")
    assert (written.n_updates, written.hidden) == (3, (4,))
    assert written.to_text() in printed
    assert "Did you mean 'fqe'" in run_command(*command, "--by", "fqa", code=1)


def test_an_empty_validation_split_is_named(tmp_path: Path) -> None:
    data = make_tiny(tmp_path / "data", n_steps=80)
    config = BCConfig(n_updates=1, batch_size=8, hidden=(8,))
    dataset = Dataset.open(data)
    train_seeds("bc", dataset.split("train"), tmp_path / "bc", seeds=(0,), config=config,
                progress=False)  # fmt: skip
    expected = f"the validation split is empty: none of {len(dataset)} episodes fell into it"
    with pytest.raises(SchemaError, match=expected):
        rank([tmp_path / "bc"], dataset_id=str(data), progress=False)


def test_runs_of_a_side_have_scores_against_one_opponent(tmp_path: Path) -> None:
    spec = preset("tag").with_updates(horizon=20)
    opponent = PolicySource(label="evader", name="random")
    team = (PolicySource(label="a", name="scripted", opponents=(opponent,)),)
    splits = Splits(block=4)
    data = make_tiny(tmp_path / "tag", id="tag-tiny-v0", spec=spec, policies=team, splits=splits)
    run, results = tmp_path / "bc", tmp_path / "results"
    changes = {"n_updates": 5, "batch_size": 8}
    train("bc", data, run, side="pursuers", n_seeds=2, changes=changes, progress=False)
    options: dict[str, Any] = {"dataset_id": str(data), "config": SMALL, "progress": False}
    with pytest.raises(SpecError, match=r"tag: pursuers, which need opponents\. Evaluate"):
        rank([run], n_episodes=2, **options)
    evaluate_target(find_target(str(run), opponents="scripted"), 2, results, progress=False)
    found = rank([run], results=results, **options)
    assert all(policy.score is not None for policy in found.policies)
    evaluate_target(find_target(str(run), opponents="idle"), 2, results, progress=False)
    with pytest.raises(SchemaError, match=r"\(tag: pursuers against idle, tag: pursuers against"):
        rank([run], results=results, **options)
