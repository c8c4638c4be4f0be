"""The recorded models give the recorded bits, and other models what a live world would have."""

import json
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmdata.datasets.dataset import Dataset
from swarmdata.datasets.reobservation import (
    OBSERVED_ARRAYS,
    RecordedEpisodes,
    attempted_links,
    observe_episodes,
    reobserve,
    reobserve_episode,
    reobserved_episode,
)
from swarmdata.errors import SpecError, UnknownNameError
from swarmdata.registry.components import TASKS, make_task
from swarmdata.registry.presets import preset, preset_names
from swarmdata.registry.published import Reference
from swarmdata.specs.model_choice import with_models
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.testing import dataset_contract as contract
from swarmdata.types import Episode
from tests.support.made_episodes import play, played, record
from tests.support.pairs import once_each

OBSERVATIONS = (
    *("state", "lidar", "bearing", "occupancy", "state+noise-0.05+delay-2"),
    "lidar-20+noise-0.05+dropout-0.2+delay-1+stack-3",
)
COMMUNICATIONS = (
    *("none", "perfect", "lossy-30+delayed-2", "goal+bursty-20+nearest-2"),
    *("state+bandwidth-1+ring+range-1.5", "learned-3+aloha-4+bits-6"),
)
PAIRED = (
    ("state-0+goal-for-0+no-velocities", "errand"),
    ("lidar+ways+stack-2+noise-0.05", "goal+lossy-30"),
    ("bearing+goal-for-3+delay-1+stack-2", "errand+lossy-40+delayed-1+expires-2"),
    ("state+body-frame+drift-0.1+landmarks-0.5+ways+delay-1", "state"),
    ("occupancy+drift-0.05+noise-0.02", "goal"),
)
MODELS = [*product(OBSERVATIONS, COMMUNICATIONS), *PAIRED]
WORLDS = [
    name
    for name in preset_names()
    if name in (*TASKS, "coop_nav-unicycle", "coop_nav-mixed")  # headings; roles
]


def short(name: str, observation: str = "state", communication: str = "none") -> TaskSpec:
    """A world whose episodes are short and, of one team, of different lengths."""
    spec = preset(name).with_updates(horizon=30)
    if len(spec.sides) == 1:
        spec = spec.with_updates(on_collision="fail")
    return with_models(spec, observation, communication)


def test_episodes_without_their_obstacles_are_refused(tmp_path: Path) -> None:
    """Those of a format without layouts would be seen in an empty arena."""
    stored = record(tmp_path / "made", short("coop_nav"), 6, "random", block=3).stored
    layouts = stored.table.layouts[:, :0]
    empty = replace(stored, table=replace(stored.table, layouts=layouts))
    with pytest.raises(SpecError, match=r"has 0 obstacles in each episode, expected \d"):
        reobserve(empty, short("coop_nav", "lidar"))


def recorded_of(episodes: list[Episode]) -> RecordedEpisodes:
    lengths = np.array([len(episode) for episode in episodes])
    return RecordedEpisodes(
        states=np.concatenate([e.states for e in episodes]),
        actions=np.concatenate([e.actions for e in episodes]),
        starts=np.cumsum(lengths) - lengths,
        lengths=lengths,
        seeds=np.array([e.seed for e in episodes], dtype=np.uint64),
        layouts=np.stack([e.layout for e in episodes]),
    )


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    folder = tmp_path_factory.mktemp("recorded") / "ds"
    made = record(folder, short("coop_nav"), 20, "random", "straight", block=4)
    return replace(made, references=Reference(-10.0, 5.0))


@pytest.fixture(scope="module")
def view(dataset: Dataset) -> Dataset:
    return dataset.reobserve("lidar", "lossy-30", progress=False)


@pytest.mark.parametrize(
    ("world", "observation", "communication"),
    [
        *once_each(WORLDS, OBSERVATIONS, COMMUNICATIONS),
        *(
            pytest.param(each.values[0], *each.values[1], marks=each.marks)
            for each in once_each(WORLDS, PAIRED)
        ),
    ],
)
def test_the_recorded_models_give_the_recorded_bits(
    world: str, observation: str, communication: str
) -> None:
    spec = short(world, observation, communication)
    episodes = play(spec, 6, "random")
    arrays = observe_episodes(make_task(spec), recorded_of(episodes), n_copies=4, progress=False)
    for name in OBSERVED_ARRAYS:
        recorded = np.concatenate([getattr(episode, name) for episode in episodes])
        assert arrays[name].dtype == recorded.dtype
        assert arrays[name].tobytes() == recorded.tobytes(), name
        assert not arrays[name].flags.writeable


@pytest.mark.slow
@given(
    models=st.sampled_from([pair for pair in MODELS if "learned" not in pair[1]]),
    n_copies=st.integers(1, 9),
    order=st.permutations(range(6)),
)
def test_neither_batches_nor_order_matter(
    models: tuple[str, str], n_copies: int, order: list[int]
) -> None:
    episodes = play(short("coop_nav"), 6, "random")
    assert len({len(episode) for episode in episodes}) > 1
    task = make_task(short("coop_nav", *models))
    shuffled = recorded_of([episodes[k] for k in order])
    together = observe_episodes(task, shuffled, n_copies=n_copies, progress=False)
    alone = [reobserve_episode(episodes[k], task) for k in order]
    for name in OBSERVED_ARRAYS:
        np.testing.assert_array_equal(together[name], np.concatenate([a[name] for a in alone]))


def test_a_view_is_what_a_live_world_shows_for_the_same_actions(view: Dataset) -> None:
    env = view.make_env(1)
    for episode in list(view)[:4]:
        step = env.reset(np.array([episode.seed], dtype=np.uint64))
        for t in range(len(episode) + 1):
            np.testing.assert_array_equal(step.states[0], episode.states[t])
            for name in OBSERVED_ARRAYS:
                np.testing.assert_array_equal(getattr(step, name)[0], getattr(episode, name)[t])
            if t < len(episode):
                step = env.step(episode.actions[t][None])


def test_a_view_keeps_the_contract_of_datasets(view: Dataset) -> None:
    contract.check_table(view)
    for index, episode in enumerate(view):
        contract.check_episode(episode, view.episodes, index)
    contract.check_statistics(view)
    contract.check_transitions(view)


def test_a_view_selects_samples_and_iterates(dataset: Dataset, view: Dataset) -> None:
    train = view.split("train").filter(policy="straight")
    np.testing.assert_array_equal(
        train.selection, dataset.split("train").filter(policy="straight").selection
    )
    size = train.make_env(2).observation_size
    assert train[0].observations.shape[-1] == size
    assert next(train.sampler(5)).observations.shape == (5, 4, size)
    assert next(train.sampler(5, horizon=3)).observations.shape == (5, 3, 4, size)
    assert train.make_env(api="pettingzoo").observation_space("robot_0").shape == (size,)
    assert view.normalized_score(5.0) == 100.0
    with pytest.raises(ValueError, match="read-only"):
        view[0].observations[...] = 0


def test_a_view_copies_only_what_is_seen_and_heard(dataset: Dataset, view: Dataset) -> None:
    for name, values in dataset.stored.arrays.items():
        assert np.shares_memory(view.stored.arrays[name], values) == (name not in OBSERVED_ARRAYS)


def test_a_view_says_what_it_is(dataset: Dataset, view: Dataset) -> None:
    (dataset.path / "card.md").write_text("# the card", encoding="utf-8")
    assert view.digest == dataset.digest
    assert view.id == dataset.id
    assert view.task.observation.kind == "lidar"
    assert view.recipe == dataset.recipe
    assert dataset.view is None
    assert view.view is not None
    models = json.loads(view.view)
    assert set(models) == {"communication", "observation"}
    assert models["communication"]["drop_probability"] == 0.3
    assert dataset.card == "# the card"
    assert view.card.endswith("# the card")
    assert "observation lidar, communication broadcast (drop_probability 0.3)" in view.card
    assert "had other inputs: observation state, communication none" in view.card
    assert "seen with observation lidar" in repr(view.split("train"))
    assert "acted on observation state, communication none" in repr(view)
    assert "seen with" not in repr(dataset)


def test_a_second_reobservation_modifies_the_first(dataset: Dataset, view: Dataset) -> None:
    again = view.split("test").reobserve(observation="=bearing", progress=False)
    direct = dataset.reobserve("bearing", "lossy-30", progress=False)
    assert again.view == direct.view
    assert len(again) == len(view.split("test"))
    np.testing.assert_array_equal(
        again.stored.arrays["observations"], direct.stored.arrays["observations"]
    )
    back = view.reobserve("state", "none", progress=False)
    assert back.view is None
    assert back.stored.arrays["observations"] is dataset.stored.arrays["observations"]
    assert view.reobserve() is view
    twice = direct.reobserve("noise-0.1", "lossy-30", progress=False)
    assert twice.task == with_models(direct.task, "noise-0.1", "lossy-30")
    assert twice.task.communication.model_dump()["drop_probability"] == pytest.approx(0.51)


def test_statistics_of_equal_models_are_those_of_the_manifest(dataset: Dataset) -> None:
    noisy = dataset.reobserve("state+noise-0.000001", progress=False)
    assert not np.array_equal(noisy[0].observations, dataset[0].observations)
    np.testing.assert_allclose(
        noisy.statistics.observation_mean, dataset.statistics.observation_mean, atol=1e-5
    )
    assert noisy.statistics.reward_mean == dataset.statistics.reward_mean


def test_learned_messages_are_part_of_the_actions(dataset: Dataset, tmp_path: Path) -> None:
    with pytest.raises(SpecError, match=r"learned messages of 2 values.* which hold none"):
        dataset.reobserve(communication="learned-2", progress=False)
    spec = short("coop_nav", "state", "learned-2")
    talking = record(tmp_path / "ds", spec, 4, "random", "straight", block=4)
    with pytest.raises(SpecError, match=r"learned messages of 3 values.*messages of 2 values"):
        talking.reobserve(communication="learned-3", progress=False)
    lossy = talking.reobserve(communication="learned-2+lossy-50", progress=False)
    np.testing.assert_array_equal(lossy[0].sent, talking[0].sent)
    assert lossy[0].delivered.sum() < talking[0].delivered.sum()
    silent = talking.reobserve("lidar", "none", progress=False)
    assert silent[0].actions.shape[-1] == silent.spec.action_size == 2
    np.testing.assert_array_equal(silent[0].actions, talking[0].actions[..., :2])
    with pytest.raises(ValueError, match="read-only"):
        silent[0].actions[...] = 0


def test_unknown_models_are_explained(dataset: Dataset) -> None:
    with pytest.raises(UnknownNameError, match="Did you mean 'lidar'"):
        dataset.reobserve("lidra")
    with pytest.raises(UnknownNameError, match="communication model"):
        dataset.reobserve(communication="lossless-3")


@pytest.mark.parametrize("drawn", [{}, {"drop_probability": (0.3, 0.5)}])
def test_lost_messages_are_those_that_a_clear_channel_delivers(drawn: dict[str, Any]) -> None:
    spec = short("coop_nav", "state", "lossy-40+range-2+delayed-1")
    spec = spec.with_updates(randomization=drawn)
    episode = played(spec, 0, "random")
    attempted = attempted_links(episode, spec)
    assert attempted is not None
    assert not (episode.delivered & ~attempted).any()
    assert 0.4 < episode.delivered.sum() / attempted.sum() < 0.8
    clear = short("coop_nav", "state", "range-2")
    heard = played(clear, 0, "random")
    np.testing.assert_array_equal(attempted_links(heard, clear), heard.delivered)
    assert attempted_links(episode, short("coop_nav")) is None


def test_one_episode_seen_again_is_that_of_the_view(dataset: Dataset, view: Dataset) -> None:
    got = reobserved_episode(dataset[2], dataset.task, view.task)
    for name in OBSERVED_ARRAYS:
        np.testing.assert_array_equal(getattr(got, name), getattr(view[2], name))
    assert got.states is dataset[2].states or np.shares_memory(got.states, dataset[2].states)
