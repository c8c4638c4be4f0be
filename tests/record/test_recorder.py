"""Recorder: what passes is what is stored, aligned, copied, and lost never."""

import contextlib
import warnings
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import (
    BuildError,
    DatasetNotFoundError,
    RecipeConflictError,
    SchemaError,
    SpecError,
    UnknownNameError,
)
from swarmdata.record import Limits, Recorder, UnfinishedEpisodeWarning, recover
from swarmdata.record.recording_folder import inspect_recording, unfinished_folder
from swarmdata.specs.origins.recording_origin import Recording
from swarmdata.specs.recipe import PolicySource, Splits
from swarmdata.specs.spaces import unflatten
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.store.split_rule import assign_splits
from swarmdata.types import END_REASONS
from tests.record import worlds
from tests.record.worlds import Choosing, Counting, play, spec_of, steady

with warnings.catch_warnings():  # PettingZoo's tests import environments the old way
    warnings.simplefilter("ignore", DeprecationWarning)
    from pettingzoo.test import parallel_api_test

ID = "counting_v1-mine-v0"


record = partial(worlds.record, act=steady)


def finish(recorder: Recorder, time: int = 0) -> None:
    """Plays the running episode to its end."""
    while recorder.agents:
        recorder.step({agent: steady(agent, time) for agent in recorder.agents})


def reason(dataset: Dataset, index: int = 0) -> str:
    return END_REASONS[dataset[index].end_reason]


@pytest.mark.slow
def test_parts_stay_few_however_many_short_episodes_there_are(tmp_path: Path) -> None:
    recorder = Recorder(Counting(length=1), id=ID, path=tmp_path / "ds")
    play(recorder, 1600, steady)
    ((_, n_written, _),) = inspect_recording(tmp_path / "ds").policies
    parts = list(unfinished_folder(tmp_path / "ds").glob("part-*"))
    assert recorder.n_episodes - n_written <= 100
    assert len(parts) < 30  # the first sixteen have 50 episodes
    recorder.pause()
    named = record(Counting(length=1), tmp_path / "named", 60, limits=Limits(episodes=10))
    assert len(named) == 60


def test_episodes_that_wait_are_counted_with_their_arrays(tmp_path: Path) -> None:
    """An episode of one step has few values, and takes kilobytes."""
    limits = Limits(episodes=1000, n_bytes=40_000)
    recorder = Recorder(Counting(length=1), id=ID, path=tmp_path / "ds", limits=limits)
    play(recorder, 60, steady)
    assert len(list(unfinished_folder(tmp_path / "ds").glob("part-*"))) >= 2
    recorder.pause()


def test_rows_are_aligned_and_copied(tmp_path: Path) -> None:
    dataset = record(Counting(length=5), tmp_path / "ds")
    assert dataset.n_episodes == 12
    for episode in dataset:
        times = np.arange(6)
        assert (episode.observations[:, :, 0] == episode.seed % 1000).all()
        assert (episode.observations[:, 0, 1] == 10 * times).all()
        assert (episode.observations[:, 1, 1] == 10 * times + 1).all()
        assert (episode.states == np.stack([np.full(6, episode.seed % 1000), times], 1)).all()
        assert (episode.actions[:, 0] == [[t % 3, 1] for t in range(5)]).all()
        assert (episode.actions[:, 1] == [[1 + t % 4, 0] for t in range(5)]).all()  # padded
        assert (episode.rewards == times[1:, None]).all()
        assert episode.truncations.tolist() == [False] * 4 + [True]
        assert not episode.terminations.any()
        assert episode.optional == ()
    spec = spec_of(dataset)
    assert (spec.task, spec.state_from) == ("counting_v1", "environment")
    assert reason(dataset) == "horizon"


def test_the_recorder_is_a_parallel_env(tmp_path: Path) -> None:
    recorder = Recorder(Counting(), id=ID, path=tmp_path / "ds", keep_unfinished=True)
    env = Counting()
    assert recorder.possible_agents == env.possible_agents
    assert recorder.unwrapped is recorder.env
    recorder.reset()
    assert recorder.state().shape == (2,)
    recorder.pause()
    second = Recorder(Choosing(), id="choosing_v2-mine-v0", path=tmp_path / "api")
    parallel_api_test(second, num_cycles=20)
    assert second.close().n_episodes == 2


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({"terminates": True}, "ended"),
        ({"terminates": True, "success": True}, "success"),
        ({"terminates": True, "success": False}, "failure"),
        ({"success": True}, "success"),
        ({"success": False}, "horizon"),
    ],
)
def test_why_an_episode_ended(tmp_path: Path, options: dict[str, Any], expected: str) -> None:
    dataset = record(Counting(**options), tmp_path / "ds")
    assert reason(dataset) == expected
    assert dataset[0].terminations[-1] == options.get("terminates", False)
    assert dataset[0].truncations[-1] != dataset[0].terminations[-1]
    assert dataset.episodes.success.all() == (expected == "success")


def test_a_state_that_is_no_method_is_none(tmp_path: Path) -> None:
    env = Counting()
    env.state = {"big": 1}  # type: ignore[assignment, method-assign]
    spec = spec_of(record(env, tmp_path / "ds"))
    assert spec.state_from == "observations"


@pytest.mark.parametrize("failed", ["small", "big", None])
def test_an_agent_that_left_early_counts_in_the_outcome(tmp_path: Path, failed: str | None) -> None:
    told = {name: name != failed for name in ("big", "small")}
    env = Counting(terminates=True, leaves={"small": 2}, success=told)
    assert reason(record(env, tmp_path / "ds")) == ("failure" if failed else "success")


def test_without_a_state_all_observations_are_it(tmp_path: Path) -> None:
    dataset = record(Counting(has_state=False), tmp_path / "ds")
    spec = spec_of(dataset)
    assert (spec.state_size, spec.state_from) == (5, "observations")
    for episode in dataset:
        both = [episode.observations[:, 0], episode.observations[:, 1, :2]]  # without padding
        assert (episode.states == np.concatenate(both, axis=1)).all()
    with pytest.raises(SchemaError, match=r"state\(\) of .* does not work"):
        record(Counting(has_state=False), tmp_path / "no", state="environment")


def test_agents_that_leave_are_masked(tmp_path: Path) -> None:
    dataset = record(Counting(length=4, leaves={"big": 2}), tmp_path / "ds")
    episode = dataset[0]
    assert episode.optional == ("alive", "agent_terminations", "agent_truncations")
    assert episode.alive is not None
    assert episode.agent_terminations is not None
    assert episode.agent_truncations is not None
    assert episode.alive.tolist() == [[True, True]] * 2 + [[False, True]] * 2 + [[False, False]]
    assert episode.agent_terminations[:, 0].tolist() == [False, True, False, False]
    assert episode.agent_truncations[:, 1].tolist() == [False, False, False, True]
    assert episode.observations[2, 0].any(), "what an agent saw last is kept"
    assert not episode.observations[3:, 0].any()
    assert not episode.actions[2:, 0].any()
    assert episode.rewards[:, 0].tolist() == [1, 2, 0, 0]
    assert reason(dataset) == "horizon"
    rows = dataset.transitions()
    np.testing.assert_array_equal(rows["alive"][:4], episode.alive[:4])
    np.testing.assert_array_equal(rows["agent_truncations"][:4], episode.agent_truncations)
    assert not rows["actions"][~rows["alive"]].any()


def test_moments_leave_out_agents_that_have_left(tmp_path: Path) -> None:
    """Zeros that nobody observed would spread features that are far from zero."""
    dataset = record(Counting(length=4, leaves={"big": 2}), tmp_path / "ds")
    train, moments = dataset.split("train"), dataset.moments
    observed = [row for e in train for row in (*e.observations[:3, 0], *e.observations[:, 1])]
    rewards = [reward for e in train for reward in (*e.rewards[:2, 0], *e.rewards[:, 1])]
    np.testing.assert_allclose(moments.observation_mean, np.mean(observed, 0))
    np.testing.assert_allclose(moments.observation_std, np.std(observed, 0), atol=1e-9)
    assert moments.reward_mean == pytest.approx(np.mean(rewards))
    assert moments.reward_std == pytest.approx(np.std(rewards))


def test_agents_may_come_later_if_they_are_known(tmp_path: Path) -> None:
    dataset = record(Counting(length=4, enters={"small": 2}), tmp_path / "ds")
    alive = dataset[0].alive
    assert alive is not None
    assert alive[:, 1].tolist() == [False, False, True, True, False]
    assert not dataset[0].observations[:2, 1].any()
    env = Counting(enters={"stranger": 1})
    env.buffers["stranger"] = np.zeros(2, np.float32)
    with pytest.raises(SchemaError, match=r"'stranger'.* not in possible_agents"):
        record(env, tmp_path / "no", 1)


@pytest.mark.parametrize("mask_in", ["info", "observation", None])
def test_every_kind_of_space_comes_back(tmp_path: Path, mask_in: str | None) -> None:
    given: list[dict[str, Any]] = []
    with Recorder(Choosing(mask_in), id="choosing_v2-mine-v0", path=tmp_path / "ds") as recorder:
        for _ in range(10):
            recorder.reset()
            while recorder.agents:
                given.append({a: recorder.action_space(a).sample() for a in recorder.agents})
                recorder.step(given[-1])
    dataset = recorder.close()
    spec = spec_of(dataset)
    rows = np.concatenate([episode.actions for episode in dataset])
    for row, actions in zip(rows, given, strict=True):
        for agent, own in zip(spec.agents, row, strict=True):
            back, action = unflatten(agent.action, own), actions[agent.name]
            assert Choosing.ACTIONS[agent.name].contains(back)
            np.testing.assert_equal(back, action)
    assert dataset[0].observations[1].tolist() == [[1.0] * 5] * 5
    masks = dataset[0].action_masks
    if mask_in is None:
        assert masks is None
        return
    assert masks is not None
    assert masks.shape == (4, 5, 5)
    assert masks[:3, 0, 0].tolist() == [True, False, True]
    assert masks[:3, 0, 1:].tolist() == [[True, True, False, False]] * 3, "three choices, padded"
    assert masks[:3, 1].all(), "no mask: all 2 + 3 choices"
    assert not masks[:, 2:].any(), "no choices"
    assert not masks[3].any(), "nobody acts at the end"


def test_each_episode_has_its_policy(tmp_path: Path) -> None:
    with Recorder(Counting(), id=ID, path=tmp_path / "ds", policies=("a", "b")) as recorder:
        for k in range(8):
            recorder.reset(policy="ab"[k % 2])
            finish(recorder, k)
        recorder.reset()
        recorder.set_policy("a")
        recorder.step({agent: steady(agent, 0) for agent in recorder.agents})
        with pytest.raises(SchemaError, match="1 steps of policy 'a'"):
            recorder.set_policy("b")
        with pytest.raises(UnknownNameError, match="policy of the recorder 'c'"):
            recorder.set_policy("c")
        finish(recorder)
    dataset = recorder.close()
    assert dataset.filter(policy="a").n_episodes == 5
    for index, name in enumerate("ab"):
        numbers = [float(each.actions[0, 0, 0]) for each in dataset.filter(policy=name)]
        assert numbers[:4] == [k % 3 for k in range(index, 8, 2)], "the actions of its episodes"


def test_when_episodes_are_written_does_not_show(tmp_path: Path) -> None:
    digests = set()
    for limit in (3, 50):
        options: dict[str, Any] = {"policies": ("a", "b"), "limits": Limits(episodes=limit)}
        with Recorder(Counting(), id=ID, path=tmp_path / str(limit), **options) as recorder:
            for k in range(8):
                recorder.reset(policy="ab"[k % 2])
                finish(recorder, k)
        digests.add(recorder.close().digest)
    assert len(digests) == 1


def test_log_probs_are_recorded_if_they_are_given(tmp_path: Path) -> None:
    recorder = Recorder(Counting(), id=ID, path=tmp_path / "ds", log_probs=True)
    for _ in range(10):
        recorder.reset()
        while recorder.agents:
            with pytest.raises(SchemaError, match="call record_log_probs before every step"):
                recorder.step({agent: steady(agent, 0) for agent in recorder.agents})
            recorder.record_log_probs(dict.fromkeys(recorder.agents, -0.5))
            recorder.step({agent: steady(agent, 0) for agent in recorder.agents})
    assert (recorder.close()[0].log_probs == -0.5).all()
    other = Recorder(Counting(), id=ID, path=tmp_path / "other")
    with pytest.raises(SchemaError, match="log_probs=True"):
        other.record_log_probs({})


def test_seeds_are_given_or_drawn_and_never_twice(tmp_path: Path) -> None:
    recorder = Recorder(Counting(), id=ID, path=tmp_path / "ds", seed=7)
    seeds = []
    for k in range(10):
        recorder.reset(seed=1000 + k if k % 2 else None)
        seeds.append(recorder.env.seed)
        finish(recorder)
    dataset = recorder.close()
    assert dataset.episodes.seeds.tolist() == seeds
    assert len(set(seeds)) == 10
    assert max(seeds) < 1 << 31
    again = Recorder(Counting(), id=ID, path=tmp_path / "again", seed=7)
    again.reset()
    assert again.env.seed == seeds[0], "drawn seeds follow from the recorder's"
    with pytest.raises(SchemaError, match="reserved for evaluation"):
        again.reset(seed=1 << 62)


def test_an_unfinished_episode_is_dropped_or_kept(tmp_path: Path) -> None:
    for keeps in (False, True):
        path = tmp_path / str(keeps)
        recorder = Recorder(Counting(), id=ID, path=path, keep_unfinished=keeps)
        play(recorder, 3, steady)
        recorder.reset()
        recorder.step({agent: steady(agent, 0) for agent in recorder.agents})
        if keeps:
            dataset = recorder.close()
            last = dataset[len(dataset) - 1]
            assert (len(last), last.truncations.tolist()) == (1, [True])
        else:
            with pytest.warns(UnfinishedEpisodeWarning, match="episode of 1 steps"):
                dataset = recorder.close()
        assert dataset.n_episodes == 3 + keeps
        assert recorder.close() is dataset


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_what_is_not_finite_is_refused_and_costs_its_episode_only(
    tmp_path: Path, value: float
) -> None:
    recorder = Recorder(Counting(), id=ID, path=tmp_path / "ds")
    play(recorder, 6, steady)
    recorder.reset()
    bad = {"big": np.array([value, 0.0]), "small": np.array([1.0])}
    with pytest.raises(SchemaError, match="action of big is not finite"):
        recorder.step(bad)
    with pytest.raises(SchemaError, match="no action of \\['small'\\]"):
        recorder.step({"big": np.zeros(2, np.float32)})
    recorder.env.buffers["big"][2] = value
    with pytest.raises(SchemaError, match="observation of big is not finite"):
        recorder.step({agent: steady(agent, 0) for agent in recorder.agents})
    with pytest.raises(SchemaError, match="call reset"):
        recorder.step({agent: steady(agent, 0) for agent in recorder.agents})
    recorder.env.buffers["big"][2] = 0
    play(recorder, 2, steady)
    assert recorder.close().n_episodes == 8


def test_a_recording_goes_on_in_another_process(tmp_path: Path) -> None:
    path = tmp_path / "ds"
    first = Recorder(Counting(), id=ID, path=path, limits=Limits(episodes=4))
    play(first, 6, steady)
    with pytest.raises(BuildError, match="is in use by process"):
        Recorder(Counting(), id=ID, path=path)
    first.pause()
    assert inspect_recording(path).policies == (("mine", 6, 24),)
    second = Recorder(Counting(), id=ID, path=path)
    assert second.n_episodes == 6
    play(second, 3, steady)
    dataset = second.close()
    assert dataset.n_episodes == 9
    assert len(set(dataset.episodes.seeds.tolist())) == 9
    whole = record(Counting(), tmp_path / "whole", 9)
    assert whole.digest == dataset.digest, "interruptions leave no trace"
    assert not unfinished_folder(path).exists()
    with pytest.raises(BuildError, match=r"exists\. Record to another path"):
        Recorder(Counting(), id=ID, path=path)


def test_another_recording_at_the_same_path_is_refused(tmp_path: Path) -> None:
    first = Recorder(Counting(), id=ID, path=tmp_path / "ds")
    play(first, 1, steady)
    first.pause()
    other = Recorder(Counting(), id=ID, path=tmp_path / "ds", policies=("theirs",))
    with pytest.raises(RecipeConflictError, match=r"'mine'.* there, .*'theirs'.* here"):
        other.reset()


def test_recover_finishes_what_an_error_left(tmp_path: Path) -> None:
    path = tmp_path / "ds"
    with (
        contextlib.suppress(ZeroDivisionError),
        Recorder(Counting(), id=ID, path=path) as recorder,
    ):
        play(recorder, 5, steady)
        raise ZeroDivisionError
    dataset = recover(unfinished_folder(path))
    assert dataset.n_episodes == 5
    assert dataset.path == path
    assert (path / "card.md").exists()
    with pytest.raises(DatasetNotFoundError, match="is finished already"):
        recover(path)
    with pytest.raises(DatasetNotFoundError, match="no unfinished recording"):
        recover(tmp_path / "nothing")


def test_nothing_recorded_is_an_error(tmp_path: Path) -> None:
    recorder = Recorder(Counting(), id=ID, path=tmp_path / "ds")
    with pytest.raises(BuildError, match="no episode was finished"):
        recorder.close()


def test_a_recording_without_train_episodes_says_so_and_keeps_them(tmp_path: Path) -> None:
    path, splits = tmp_path / "ds", Splits(block=3)
    draft = Recording(
        id=ID, spec=TaskSpec(), policies=(PolicySource(label="mine", name="external"),),
        source="recorder", splits=splits,
    )  # fmt: skip
    seed = next(
        k for k in range(100) if assign_splits(draft.model_copy(update={"seed": k}), [(0, 0)])[0]
    )
    recorder = Recorder(Counting(), id=ID, path=path, seed=seed, splits=splits)
    play(recorder, 1, steady)
    with pytest.raises(BuildError, match="none of which falls into the train split"):
        recorder.close()
    more = Recorder(Counting(), id=ID, path=path, seed=seed, splits=splits)
    assert more.n_episodes == 1
    play(more, 2, steady)
    assert more.close().n_episodes == 3


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"id": "other-mine-v0"}, "does not begin with the environment's name"),
        ({"id": "counting_v1-mine"}, "id"),
        ({"policies": ("a", "a")}, "different labels"),
    ],
)
def test_a_bad_description_is_refused_at_once(
    tmp_path: Path, options: dict[str, Any], message: str
) -> None:
    arguments = {"id": ID, "path": tmp_path / "ds", **options}
    with pytest.raises(SpecError, match=message):
        Recorder(Counting(), **arguments)


@settings(max_examples=4)  # each makes a dataset
@given(lengths=st.lists(st.integers(1, 6), min_size=3, max_size=8), limit=st.integers(1, 4))
def test_any_lengths_in_parts_of_any_size_give_the_same_episodes(
    tmp_path_factory: pytest.TempPathFactory, lengths: list[int], limit: int
) -> None:
    path = tmp_path_factory.mktemp("any") / "ds"
    env = Counting()
    with Recorder(env, id=ID, path=path, limits=Limits(episodes=limit)) as recorder:
        for length in lengths:
            env.length = length
            play(recorder, 1, steady)
    dataset = recorder.close()
    assert dataset.episodes.lengths.tolist() == lengths
    for episode, length in zip(dataset, lengths, strict=True):
        assert episode.rewards[:, 0].tolist() == list(range(1, length + 1))


def test_what_users_say_is_kept(tmp_path: Path) -> None:
    said = {"author": "Ada", "license": "mit"}
    dataset = record(Counting(), tmp_path / "ds", metadata=said, options={"length": 4})
    assert isinstance(dataset.recipe, Recording)
    assert dataset.recipe.metadata == said
    assert spec_of(dataset).options == {"length": 4}
    assert "| author | Ada |" in dataset.card
    assert "| code | not given |" in dataset.card
