"""Rewards of other weights: those of a world with these weights, and the recorded ones back."""

import hashlib
import json
import pickle
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from swarmdata.building.edit import filter_dataset
from swarmdata.datasets.dataset import Dataset
from swarmdata.datasets.mixture import mix
from swarmdata.datasets.reweighting import Reweighting
from swarmdata.errors import ConversionError, SchemaError, SpecError, UnknownNameError
from swarmdata.interop.export import export_dataset
from swarmdata.registry.components import TASKS
from swarmdata.registry.presets import preset
from swarmdata.registry.published import Reference
from swarmdata.specs.rules import changed_weights
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.testing.synthetic import make_dataset
from swarmdata.types import Episode, Float
from tests.support.made_episodes import play, record
from tests.support.own_rewards import effort
from tests.support.pairs import every

CHANGES = {"robot_collision": 1.5, "time": 0.0, "proximity": 0.3, "team_share": 0.25}


def short(name: str) -> TaskSpec:
    return preset(name).with_updates(horizon=30)


def with_weights(spec: TaskSpec, **changes: float) -> TaskSpec:
    weights = changed_weights(spec.rules.rewards, changes)
    return spec.with_updates(rules=spec.rules.model_copy(update={"rewards": weights}))


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    folder = tmp_path_factory.mktemp("reweighted") / "ds"
    return record(folder, short("coop_nav"), 12, "straight", block=5)


@pytest.mark.parametrize("task", every(3, list(TASKS)))
def test_rewards_are_those_of_a_world_with_these_weights(task: str, tmp_path: Path) -> None:
    recorded = record(tmp_path / "ds", short(task), 12, "straight", block=5)
    view = recorded.with_rewards(**CHANGES)
    changed = play(with_weights(short(task), **CHANGES), 12)
    assert len(view) == len(changed)
    for ours, theirs, old in zip(view, changed, recorded, strict=True):
        np.testing.assert_array_equal(ours.rewards, theirs.rewards)
        assert ours.team_return == theirs.team_return
        assert ours.observations is not None
        np.testing.assert_array_equal(ours.states, old.states)
    returns = [episode.team_return for episode in changed]
    assert view.episodes.team_return.tolist() == returns
    assert recorded.episodes.team_return.tolist() != returns


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(weight=st.floats(0, 1e3), share=st.floats(0, 1))
def test_the_recorded_weights_give_the_recorded_bits(
    dataset: Dataset, weight: float, share: float
) -> None:
    rewards = dataset.task.rules.rewards
    there = dataset.with_rewards(robot_collision=weight, team_share=share)
    back = there.with_rewards(robot_collision=rewards.robot_collision, team_share=0.0)
    assert back.view is None
    assert repr(back) == repr(dataset)
    for name in ("rewards", "episodes/team_return"):
        np.testing.assert_array_equal(back.stored.arrays[name], dataset.stored.arrays[name])
    np.testing.assert_array_equal(back.episodes.team_return, dataset.episodes.team_return)


def test_other_rewards_have_no_score(dataset: Dataset) -> None:
    scored = replace(dataset, references=Reference(no_skill=-2.0, expert=8.0))
    weighted, relabelled = scored.with_rewards(time=0.0), scored.with_rewards(effort)
    for view in (weighted, weighted[:2], relabelled, mix([weighted, weighted])):
        with pytest.raises(SchemaError, match=r"has other rewards than its task.*`evaluate`"):
            view.normalized_score(3.0)
    time = dataset.task.rules.rewards.time
    back = scored.with_rewards(time=0.0).with_rewards(time=time)
    assert float(back.normalized_score(3.0)) == 50.0, "the recorded ones again"


def test_all_readers_see_the_new_rewards(dataset: Dataset) -> None:
    view = dataset.with_rewards(**CHANGES)
    rewards = np.concatenate([episode.rewards for episode in view])
    np.testing.assert_array_equal(view.transitions()["rewards"], rewards)
    draws = view.sampler(32, seed=1), dataset.sampler(32, seed=1)
    rows = draws[0].draw()
    np.testing.assert_array_equal(draws[0].gather(rows).rewards, rewards[rows])
    assert (draws[1].gather(rows).rewards != rewards[rows]).any()
    windows = view.sampler(4, horizon=5, seed=1)
    starts = windows.draw()
    np.testing.assert_array_equal(windows.gather(starts).rewards[:, 0], rewards[starts])
    train = np.concatenate([episode.rewards.ravel() for episode in view.split("train")])
    assert view.statistics.reward_mean == pytest.approx(train.mean(dtype=np.float64))
    assert view.statistics.reward_std == pytest.approx(train.std(dtype=np.float64))
    median = float(np.median(view.episodes.team_return))
    assert all(each.team_return >= median for each in view.filter(min_return=median))
    copy = pickle.loads(pickle.dumps(view.stored))
    np.testing.assert_array_equal(copy.table.team_return, view.episodes.team_return)


def test_a_view_says_what_it_is(dataset: Dataset) -> None:
    view = dataset.with_rewards(robot_collision="1.5", time=0)
    assert view.view == '{"rewards":{"robot_collision":1.5,"time":0.0}}'
    assert "rewards with time 0, robot_collision 1.5;" in repr(view)
    assert view.spec == dataset.spec
    assert view.digest == dataset.digest
    assert view.with_rewards() is view
    assert isinstance(view.reweighting, Reweighting)
    assert "robot_collision 1.5 instead of 1" in view.reweighting.note
    assert view.reweighting.applied_to(dataset.task) == with_weights(
        dataset.task, robot_collision=1.5, time=0.0
    )


def test_it_goes_with_other_models_in_any_order(dataset: Dataset) -> None:
    first = dataset.with_rewards(**CHANGES).reobserve("lidar", progress=False)
    second = dataset.reobserve("lidar", progress=False).with_rewards(**CHANGES)
    assert first.view == second.view
    assert set(json.loads(first.view or "")) == {"communication", "observation", "rewards"}
    for name, array in first.stored.arrays.items():
        np.testing.assert_array_equal(array, second.stored.arrays[name])
    weights = {name: getattr(dataset.task.rules.rewards, name) for name in CHANGES}
    for view in (first, second):
        plain = view.with_rewards(**weights).reobserve("state", progress=False)
        assert plain.view is None
        for name, array in dataset.stored.arrays.items():
            np.testing.assert_array_equal(plain.stored.arrays[name], array)
        rewards = view.reobserve("state", progress=False).stored.arrays["rewards"]
        np.testing.assert_array_equal(rewards, first.stored.arrays["rewards"])


def test_wrong_weights_are_refused(dataset: Dataset, tmp_path: Path) -> None:
    with pytest.raises(
        UnknownNameError,
        match=r"'robot_colision'.*Known: .*robot_contact, success, team_share, time\.",
    ):
        dataset.with_rewards(robot_colision=1.0)
    with pytest.raises(SpecError, match="team_share"):
        dataset.with_rewards(team_share=1.5)
    with pytest.raises(SpecError, match="other rewards than were recorded"):
        filter_dataset(dataset.with_rewards(time=0.0), tmp_path / "out", id="coop_nav-cut-v0")


def test_rewards_of_a_function_are_those_that_readers_see(tmp_path: Path) -> None:
    make_dataset(tmp_path / "ds", [[5] * 10])  # without terms of rewards
    plain = Dataset.open(tmp_path / "ds")
    view = plain.with_rewards(effort)
    expected = [effort(episode).astype(np.float32) for episode in plain]
    for ours, rewards in zip(view, expected, strict=True):
        np.testing.assert_array_equal(ours.rewards, rewards)
    np.testing.assert_array_equal(view.transitions()["rewards"], np.concatenate(expected))
    assert view.episodes.team_return.tolist() == [episode.team_return for episode in view]
    train = np.concatenate([episode.rewards.ravel() for episode in view.split("train")])
    assert view.statistics.reward_mean == pytest.approx(train.mean(dtype=np.float64))
    assert view[2:].with_rewards(effort).view == view.view  # of the whole dataset, whatever is seen
    twice = view.with_rewards(lambda episode: 2 * episode.rewards)
    np.testing.assert_array_equal(twice[0].rewards, 2 * expected[0])
    assert twice.digest == plain.digest


def test_a_view_names_its_function_and_digests_its_rewards(dataset: Dataset) -> None:
    view = dataset.with_rewards(effort)
    changes = json.loads(view.view or "")["rewards"]
    assert changes["function"] == "effort"
    assert changes["sha256"] == hashlib.sha256(view.stored.arrays["rewards"].data).hexdigest()
    assert "rewards with function effort;" in repr(view)
    assert view.reweighting is not None
    assert "by the function `effort`" in view.reweighting.note
    assert view.spec == dataset.spec


def test_a_function_sees_the_view_and_gives_way_to_weights(dataset: Dataset) -> None:
    seen = dataset.reobserve("lidar-8", progress=False)
    sizes = {episode.observations.shape for episode in seen}
    found: list[tuple[int, ...]] = []

    def clearance(episode: Episode) -> Float:
        found.append(episode.observations.shape)
        return episode.observations[1:].min(axis=2)

    view = seen.with_rewards(clearance)
    assert set(found) == sizes
    plain = view.reobserve("state", progress=False)
    np.testing.assert_array_equal(plain[0].rewards, view[0].rewards)
    assert view.with_rewards(time=0.0).view == seen.with_rewards(time=0.0).view


@pytest.mark.parametrize(
    ("function", "problem"),
    [
        (lambda episode: episode.rewards[:-1], r"gave the shape \(\d+, 4\) for episode 0 of"),
        (lambda episode: episode.rewards * np.nan, "gave a number that is not finite"),
        (lambda episode: np.full(episode.rewards.shape, 1e39), "gave a number that is not finite"),
        (lambda episode: "much", "gave 'much' for episode 0 of .*, expected finite rewards of"),
    ],
)
def test_rewards_of_another_form_are_refused(
    dataset: Dataset, function: Callable[[Episode], Float], problem: str
) -> None:
    with pytest.raises(SchemaError, match=problem):
        dataset.with_rewards(function)


def test_rewards_of_a_function_are_not_exported_as_those_of_the_task(
    dataset: Dataset, tmp_path: Path
) -> None:
    with pytest.raises(ConversionError, match="rewards of a function, which an export cannot"):
        export_dataset(dataset.with_rewards(effort), tmp_path / "out", format="numpy")
    assert list(tmp_path.iterdir()) == []


def test_a_function_and_weights_are_refused(dataset: Dataset) -> None:
    with pytest.raises(SchemaError, match="a function and weights of time, expected one of them"):
        dataset.with_rewards(effort, time=0.0)


def test_a_dataset_without_terms_says_so(tmp_path: Path) -> None:
    make_dataset(tmp_path / "ds", [[5] * 10])
    with pytest.raises(SchemaError, match="has no array reward_terms"):
        Dataset.open(tmp_path / "ds").with_rewards(time=0.0)
