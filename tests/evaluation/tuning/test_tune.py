"""A tuning of seconds on tiny datasets."""

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
import yaml

pytest.importorskip("torch", reason="tuning needs the torch extra")

from swarmdata.errors import OutputError, ResultsError, SpecError, StaleCellError, UnknownNameError
from swarmdata.evaluation.results import result_set
from swarmdata.evaluation.runs.train import read_settings
from swarmdata.evaluation.study.cells import cell_worker
from swarmdata.evaluation.tuning import tune as tune_module
from swarmdata.evaluation.tuning.tune import tune
from swarmdata.evaluation.tuning.tuning_record import Tuning
from swarmdata.interop.logs.import_logs import import_logs
from swarmdata.learn.evaluation.fqe import FQEConfig
from swarmdata.learn.training.settings import as_texts, check_effects, override
from swarmdata.learn.training.trainer import train_seeds
from swarmdata.offline_algos.bc import BCConfig
from swarmdata.offline_algos.vdn import VDNConfig
from swarmdata.registry.published import Reference
from tests.evaluation.study.conftest import work_here
from tests.interop.logs.logged_team import log_map, write_team
from tests.support.command_line import run
from tests.support.measured import csv_rows
from tests.support.tiny import make_tiny

SMALL = {"hidden": "8", "batch_size": 16}
Tune = Callable[..., Tuning]


@pytest.fixture(scope="module")
def small_tune(data: Path) -> Iterator[Tune]:
    """Tunes `bc` on a tiny dataset, with small fits; arguments replace those of `tune`."""

    def call(out: Path, *, algorithm: str = "bc", datasets: Any = None, **changes: Any) -> Tuning:
        options = {
            "n_trials": 3, "n_updates": 10, "n_seeds": 1, "n_steps": None, "n_episodes": 4,
            "changes": SMALL, "progress": False, **changes,
        }  # fmt: skip
        return tune(algorithm, [data] if datasets is None else datasets, out, **options)

    fits = FQEConfig(n_updates=20, hidden=(8,), n_fits=2, batch_size=16)
    with pytest.MonkeyPatch.context() as patch:
        work_here(patch)
        patch.setattr(tune_module, "FITS", fits)
        yield call


class Tuned(NamedTuple):
    """A tuning that is done."""

    out: Path
    made: Tuning


@pytest.fixture(scope="module")
def tuned(small_tune: Tune, tmp_path_factory: pytest.TempPathFactory) -> Tuned:
    out = tmp_path_factory.mktemp("tuned") / "out"
    return Tuned(out, small_tune(out, n_seeds=2))


def test_the_default_and_drawn_trials_are_trained_scored_and_estimated(tuned: Tuned) -> None:
    made = tuned.made
    first, *others = made.trials
    assert first.settings == {}
    assert first.config == {"n_updates": 10, "batch_size": 16, "hidden": [8]}
    assert all(each.config == {**first.config, **each.settings} for each in others)
    assert len({each.settings["learning_rate"] for each in others}) == 2
    (name,) = made.datasets
    assert all(np.isfinite(each.scores[name]) for each in made.trials)
    assert all(each.estimates[name]["imitation_error"] > 0 for each in made.trials)
    scores = [each.scores[name] for each in made.trials]
    assert made.choice("validation") == int(np.argmax(scores))
    values = [each.estimates[name]["fqe_pessimistic"] for each in made.trials]
    assert made.choice("offline") == int(np.argmax(values))
    cell = tuned.out / "cells/trial-00" / name
    document = yaml.safe_load((cell / "cell.json").read_text())
    assert (document["block"], document["seeds"]) == ("validation", [0, 1])


def test_the_chosen_settings_are_a_config_of_train(tuned: Tuned) -> None:
    made = tuned.made
    for rule in ("validation", "offline"):
        chosen = made.trials[made.choice(rule)]
        read = read_settings(str(tuned.out / f"{rule}.yaml"))
        config = override(BCConfig(), read)
        rate = chosen.settings.get("learning_rate", BCConfig().learning_rate)
        assert config == BCConfig(n_updates=10, batch_size=16, hidden=(8,), learning_rate=rate)
    rows = csv_rows((tuned.out / "trials.csv").read_text())
    assert [row["chosen by validation episodes"] for row in rows].count("1") == 1
    assert [row["trial"] for row in rows] == ["0", "1", "2"]
    curve = csv_rows((tuned.out / "curve.csv").read_text())
    ends = float(curve[0]["validation"]), float(curve[-1]["validation"])
    assert ends == pytest.approx((made.scores[0], made.scores.max()), rel=1e-6)


def test_a_setting_reaches_the_trials_in_which_it_has_an_effect(
    small_tune: Tune, tmp_path: Path
) -> None:
    changes = {**SMALL, "behavior_head": "joint"}  # of `bc` by default; trial 1 draws `cql`
    options = {"n_trials": 2, "n_updates": 2, "draws": 1, "changes": changes}
    made = small_tune(tmp_path / "out", algorithm="vdn", **options)
    for each, regulariser, head in zip(
        made.trials, ("bc", "cql"), ("joint", "factored"), strict=True
    ):
        config = override(VDNConfig(), as_texts(each.config))
        assert (config.regulariser, config.behavior_head) == (regulariser, head)
        check_effects(config, each.config)  # as `train --config` does
    with pytest.raises(SpecError, match=r"memory_size.* has no effect with memory 'none'"):
        small_tune(tmp_path / "a", changes={"memory_size": 8})
    assert not (tmp_path / "a").exists()


@pytest.mark.slow
def test_a_second_call_trains_nothing_and_more_trials_train_only_these(
    small_tune: Tune, tuned: Tuned, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = shutil.copytree(tuned.out, tmp_path / "out")
    trained: list[str] = []

    def count(algorithm: str, data: Any, run: Path, **options: Any) -> Any:
        trained.append(run.name)
        return train_seeds(algorithm, data, run, **options)

    monkeypatch.setattr(cell_worker, "train_seeds", count)
    with monkeypatch.context() as patch:
        patch.setattr(tune_module, "rank", lambda *_, **__: pytest.fail("ranked again"))
        assert small_tune(out, n_seeds=2) == tuned.made
    assert trained == []
    assert small_tune(out, n_trials=4, n_seeds=2).trials[:3] == tuned.made.trials
    assert trained == ["trial-03"]


@pytest.mark.slow
def test_estimates_may_be_left_out_and_added_later(
    small_tune: Tune, tuned: Tuned, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    without = small_tune(out, n_seeds=2, estimates=False)
    assert without.rules == ("validation",)
    assert "offline estimates: they were left out (--no-estimates)" in without.caption
    assert not (out / "offline.yaml").exists()
    assert [each.scores for each in without.trials] == [each.scores for each in tuned.made.trials]
    assert small_tune(out, n_seeds=2) == tuned.made
    assert (out / "offline.yaml").exists()


@pytest.mark.slow
def test_two_datasets_and_their_first_steps(
    small_tune: Tune,
    tmp_path: Path,
    data: Path,
    other_data: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with pytest.raises(ResultsError, match="coop_nav-tiny-v0 has no measured references"):
        small_tune(tmp_path, datasets=[data, other_data])
    assert not (tmp_path / "cells").exists()
    for module in (tune_module, result_set):
        monkeypatch.setattr(module, "reference_of", lambda spec: Reference(-20.0, 10.0))
    made = small_tune(tmp_path, datasets=[data, other_data], n_trials=2, n_steps=200)
    assert list(made.datasets) == ["coop_nav-tiny-v0-200", "coop_nav-other-v0-200"]
    assert made.unit == "score"
    score = made.trials[0].scores
    assert made.scores[0] == pytest.approx(np.mean([*score.values()]))
    whole = small_tune(tmp_path / "whole", n_trials=2, n_steps=10_000)
    assert list(whole.datasets) == ["coop_nav-tiny-v0"]


@pytest.mark.slow
def test_policies_that_tell_no_actions_are_chosen_by_validation_only(
    small_tune: Tune, tmp_path: Path
) -> None:
    made = small_tune(tmp_path, algorithm="bc_latent", n_trials=2)
    assert made.rules == ("validation",)
    assert "policies of bc_latent draw their actions" in made.caption
    assert not (tmp_path / "offline.yaml").exists()
    assert (tmp_path / "validation.yaml").exists()


@pytest.mark.slow
def test_data_without_validation_episodes_are_chosen_on_by_validation_only(
    small_tune: Tune, tmp_path: Path
) -> None:
    data = make_tiny(tmp_path / "coop_nav-short-v0", id="coop_nav-short-v0", n_steps=80)
    made = small_tune(tmp_path / "out", datasets=[data], n_trials=2)
    assert "coop_nav-short-v0: the validation split is empty" in str(made.without_estimates)


def import_team(folder: Path, seconds: float) -> Path:
    """A recording without a simulator, in episodes of two seconds."""
    cuts = log_map(episodes={"length": 2.0})
    logs = write_team(folder, seconds)
    return import_logs(logs, folder / "hall-logs-v0", log_map=cuts, id="hall-logs-v0").path


@pytest.mark.slow
def test_logs_without_a_simulator_are_chosen_on_by_estimates_only(
    small_tune: Tune, tmp_path: Path
) -> None:
    made = small_tune(
        tmp_path / "out", datasets=[import_team(tmp_path, 60.0)], n_trials=2, n_updates=4
    )
    assert made.rules == ("offline",)
    assert all(each.failure is None and not each.scores for each in made.trials)
    assert "The data have no simulator" in made.caption
    assert "fqe_pessimistic of hall-logs-v0" in made.to_text()
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert "offline.yaml" in names
    assert not names & {"validation.yaml", "curve.csv", "curve.png"}


def test_logs_that_no_rule_can_choose_on_are_refused_before_the_second_trial(
    small_tune: Tune, tmp_path: Path
) -> None:
    few = import_team(tmp_path, 9.0)
    with pytest.raises(SpecError, match="no simulator, so that only offline estimates can choose"):
        small_tune(tmp_path / "out", datasets=[few], estimates=False)
    with pytest.raises(ResultsError, match="the validation split is empty: none of 5 episodes"):
        small_tune(tmp_path / "out", datasets=[few])
    assert not (tmp_path / "out" / "cells").exists()
    (tmp_path / "long").mkdir()
    many = import_team(tmp_path / "long", 60.0)
    with pytest.raises(ResultsError, match="policies of bc_latent draw their actions"):
        small_tune(tmp_path / "latent", algorithm="bc_latent", datasets=[many], n_updates=2)
    assert [path.name for path in (tmp_path / "latent" / "cells").iterdir()] == ["trial-00"]


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::swarmdata.hub.catalog.catalog.AnotherDatasetWarning")
def test_a_folder_may_hold_other_data_under_a_published_name(
    small_tune: Tune, tmp_path: Path
) -> None:
    data = make_tiny(tmp_path / "coop_nav-medium", id="coop_nav-medium-v1")
    made = small_tune(tmp_path / "out", datasets=[data], n_trials=2)
    assert np.isfinite(made.scores).all()


@pytest.mark.slow
def test_a_trial_that_fails_is_not_chosen(
    small_tune: Tune, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(algorithm: str, data: Any, run: Path, **options: Any) -> Any:
        if run.name == "trial-01":
            raise FloatingPointError("a loss is infinite")
        return train_seeds(algorithm, data, run, **options)

    monkeypatch.setattr(cell_worker, "train_seeds", fail)
    made = small_tune(tmp_path)
    assert "a loss is infinite" in (made.trials[1].failure or "")
    assert made.trials[1].scores == {}
    assert {made.choice(rule) for rule in made.rules} <= {0, 2}
    assert np.isfinite(made.curve("validation")).all()
    assert "3 trials, 1 of them failed" in made.caption
    monkeypatch.setattr(cell_worker, "train_seeds", lambda *_, **__: 1 / 0)
    with pytest.raises(ResultsError, match=r"all trials of bc failed: .*ZeroDivisionError"):
        small_tune(tmp_path / "none", n_trials=2)


def test_mistakes_are_refused_before_any_training(
    small_tune: Tune, tuned: Tuned, tmp_path: Path, data: Path
) -> None:
    with pytest.raises(SpecError, match="n_trials is 1"):
        small_tune(tmp_path / "a", n_trials=1)
    with pytest.raises(UnknownNameError, match="hiden"):
        small_tune(tmp_path / "a", changes={"hiden": "8"})
    with pytest.raises(SpecError, match="changes has n_updates"):
        small_tune(tmp_path / "a", changes={"n_updates": 3})
    copy = shutil.copytree(data, tmp_path / "b" / data.name)
    with pytest.raises(SpecError, match="two datasets are called coop_nav-tiny-v0"):
        small_tune(tmp_path / "a", datasets=[data, copy])
    assert not (tmp_path / "a").exists()
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "notes.txt").write_text("mine")
    with pytest.raises(OutputError, match=r"notes\.txt"):
        small_tune(tmp_path / "mine")
    out = shutil.copytree(tuned.out, tmp_path / "c")
    with pytest.raises(StaleCellError, match="n_episodes is 4"):
        small_tune(out, n_seeds=2, n_episodes=5)
    with pytest.raises(StaleCellError, match=r"on coop_nav-tiny-v0, not coop_nav-tiny-v0-20: "):
        small_tune(out, n_seeds=2, n_steps=20)


@pytest.mark.slow
@pytest.mark.usefixtures("small_tune")
def test_the_command_prints_the_choices(tmp_path: Path, data: Path) -> None:
    line = f"tune bc {data} --out {tmp_path / 'out'} --trials 2 --updates 5 --seeds 1 --episodes 2"
    settings = tmp_path / "settings.yaml"
    settings.write_text("n_updates: 9\nhidden: 8\n")
    printed = run(*line.split(), "--config", settings)
    assert "chosen by validation episodes" in printed
    assert "2 trials, 0 of them failed" in printed
