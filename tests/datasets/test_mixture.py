"""Mixtures of datasets: batches, statistics, identity, and what is refused."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmdata.building.edit import combine_datasets
from swarmdata.datasets.dataset import Dataset
from swarmdata.datasets.mixture import Mixture, mix
from swarmdata.errors import SchemaError, SpecError, UnknownNameError
from swarmdata.hub.catalog.catalog import load
from swarmdata.learn.networks.dataset_statistics import Statistics
from swarmdata.learn.training.training_data import framed
from swarmdata.perception.frames import find_frame
from swarmdata.perception.observer import features_of
from swarmdata.record import Recorder
from swarmdata.registry.components import make_task
from swarmdata.registry.presets import preset
from swarmdata.specs.recipe import PolicySource
from swarmdata.testing.synthetic import make_episode, make_recipe
from tests.record.worlds import Counting, steady
from tests.support.made_episodes import left_early, stored
from tests.support.tiny import TINY, make_tiny

WEIGHTS = (0.8, 0.2)


@pytest.fixture(scope="module")
def parts(tmp_path_factory: pytest.TempPathFactory, tiny: Path) -> tuple[Dataset, Dataset]:
    """The same task, other episodes and policies, another number of steps."""
    other = {"id": "coop_nav-other-v0", "seed": 6, "n_steps": 900}
    made = make_tiny(tmp_path_factory.mktemp("parts") / "other", **other)
    return Dataset.open(tiny), Dataset.open(made)


@pytest.fixture(scope="module")
def mixture(parts: tuple[Dataset, Dataset]) -> Mixture:
    return mix(parts, [8, 2])


def shares(mixture: Mixture, n_batches: int = 60) -> float:
    """The part of drawn rows whose rewards are of the first dataset."""
    sampler = mixture.sampler(100, seed=3)
    drawn = np.concatenate([sampler.draw() for _ in range(n_batches)])
    return float((drawn < mixture.parts[0].n_steps).mean())


def test_rows_are_drawn_with_the_weights(mixture: Mixture) -> None:
    assert mixture.weights == WEIGHTS
    assert shares(mixture) == pytest.approx(0.8, abs=0.02)


def test_without_weights_every_transition_is_equally_likely(parts: tuple[Dataset, Dataset]) -> None:
    whole = mix(parts)
    n_steps = [part.n_steps for part in parts]
    assert whole.weights == pytest.approx(np.array(n_steps) / sum(n_steps))
    assert shares(whole) == pytest.approx(n_steps[0] / sum(n_steps), abs=0.02)
    np.testing.assert_allclose(whole.step_weights(), 1.0)


def test_batches_hold_the_rows_of_the_parts(
    mixture: Mixture, parts: tuple[Dataset, Dataset]
) -> None:
    index = np.stack([mixture.sampler(20, seed=seed).draw() for seed in (0, 1)])  # [K, B]
    batch = mixture.sampler(20, seed=0).gather(index)
    assert batch.observations.shape[:2] == (2, 20)
    tables = [part.transitions() for part in parts]
    for place in np.ndindex(*index.shape):
        row = int(index[place])
        part = int(row >= parts[0].n_steps)
        expected = tables[part]
        own = row - part * parts[0].n_steps
        for name in ("observations", "actions", "rewards", "next_states", "terminations"):
            np.testing.assert_array_equal(getattr(batch, name)[place], expected[name][own])
    with pytest.raises(IndexError, match="index -1 to -1"):
        mixture.sampler(4).gather(np.array([-1]))


def test_a_stream_resumes(mixture: Mixture, parts: tuple[Dataset, Dataset]) -> None:
    ours, theirs = (mixture.sampler(16, seed=2) for _ in range(2))
    for _ in range(3):
        ours.draw()
    theirs.load_state_dict(ours.state_dict())
    np.testing.assert_array_equal(ours.draw(), theirs.draw())
    with pytest.raises(SchemaError, match="resume with the settings and the data"):
        mix(parts[::-1]).sampler(16, seed=2).load_state_dict(ours.state_dict())
    ours, theirs = (mixture.sampler(16, horizon=4, burn_in=steps, seed=2) for steps in (2, 3))
    with pytest.raises(SchemaError, match="'burn_in': 2"):
        theirs.load_state_dict(ours.state_dict())


def test_statistics_are_those_of_what_is_drawn(mixture: Mixture) -> None:
    """As many rows as they take."""
    train = mixture.split("train")
    sampler = train.sampler(40_000, seed=0)
    batch = next(sampler)
    std = np.maximum(train.moments.observation_std, 0.05)
    error = batch.observations.mean((0, 1)) - train.moments.observation_mean
    assert np.abs(error / std).max() < 0.05
    np.testing.assert_allclose(
        batch.observations.std((0, 1)), train.moments.observation_std, atol=0.05
    )
    measured = Statistics.measure(train, 0.9)
    np.testing.assert_allclose(batch.states.mean(0), measured.state_mean, atol=0.06)
    np.testing.assert_allclose(batch.states.std(0), measured.state_std, atol=0.06)


def test_the_return_to_go_deviates_by_the_weights(parts: tuple[Dataset, Dataset]) -> None:
    """A mixture of nearly nothing but one dataset has its deviation."""
    alone = [Statistics.measure(part, 0.9) for part in parts]
    nearly = Statistics.measure(mix(parts, [1e9, 1]), 0.9)
    assert nearly.return_std == pytest.approx(alone[0].return_std, rel=1e-4)
    assert nearly.max_return == max(each.max_return for each in alone)
    assert alone[0].return_std != pytest.approx(alone[1].return_std, rel=1e-3)


def test_episodes_are_numbered_through_all_parts(mixture: Mixture) -> None:
    sampler = mixture.sampler(400, seed=1)
    index = sampler.draw()
    episodes = sampler.gather(index).episodes
    is_first, n_first = index < mixture.parts[0].n_steps, len(mixture.parts[0])
    assert set(np.unique(episodes[is_first])) == set(range(n_first))
    assert set(np.unique(episodes[~is_first])) == set(range(n_first, len(mixture)))


def test_who_acts_is_known_of_a_mixture_as_of_the_combined_dataset(tmp_path: Path) -> None:
    """A batch had no `alive` where one of the datasets had none, so actors learned from absence."""
    whole = [make_episode(6, k) for k in range(12)]
    left = [left_early(make_episode(6, 100 + k)) for k in range(12)]
    both = [
        stored(
            tmp_path / name, make_recipe(40).model_copy(update={"id": f"coop_nav-{name}-v0"}), [e]
        )
        for name, e in (("whole", whole), ("left", left))
    ]
    rows = np.arange(sum(part.n_steps for part in both))
    combined = combine_datasets(both, tmp_path / "both", id="coop_nav-both-v0")
    for sizes in ({}, {"horizon": 4}):
        got = mix(both).sampler(8, **sizes).gather(rows)
        expected = combined.sampler(8, **sizes).gather(rows)
        for name in ("alive", "agent_terminations", "next_alive", "rewards"):
            np.testing.assert_array_equal(getattr(got, name), getattr(expected, name))
    streamed = load([part.path for part in both], stream=True)
    drawn = next(streamed.sampler(64))
    assert not drawn.alive.all(), "of the part that agents leave"
    assert not drawn.rewards[~drawn.alive].any()
    measured = [Statistics.measure(data, 0.9) for data in (mix(both), combined)]
    for name in ("own_return_std", "own_max_return", "own_return_range", "return_std"):
        assert getattr(measured[0], name) == pytest.approx(getattr(measured[1], name))
    few = mix(both).sampler(8).gather(rows, frozenset({"alive"}))
    assert few.alive is not None
    assert few.next_alive is few.rewards is None


def test_only_the_wanted_fields_are_read(mixture: Mixture) -> None:
    sampler = mixture.sampler(40, seed=1)
    index = sampler.draw()
    some, whole = sampler.gather(index, {"actions", "episodes"}), sampler.gather(index)
    assert some.observations is None
    np.testing.assert_array_equal(some.actions, whole.actions)
    np.testing.assert_array_equal(some.episodes, whole.episodes)


@pytest.mark.parametrize("burn_in", [None, 2])
def test_windows_and_segments_are_those_of_the_parts(mixture: Mixture, burn_in: int | None) -> None:
    sampler, first = (
        data.sampler(64, horizon=4, burn_in=burn_in, seed=1) for data in (mixture, mixture.parts[0])
    )
    index = sampler.draw()
    own = index < mixture.parts[0].n_steps
    ours, theirs = sampler.gather(index), first.gather(index[own])
    assert ours.mask.shape == (64, 4 + (burn_in or 0))
    np.testing.assert_array_equal(ours.observations[own], theirs.observations)
    np.testing.assert_array_equal(ours.mask[own], theirs.mask)


def test_frames_keep_the_weights(mixture: Mixture) -> None:
    frame = find_frame(features_of(make_task(TINY.spec)), "target")
    data = framed(mixture, frame)
    ours, theirs = (Statistics.measure(each, 0.9) for each in (data, mixture))
    assert ours.return_std == theirs.return_std
    assert len(ours.observation_mean) > len(theirs.observation_mean)


def test_identity_says_what_was_mixed(mixture: Mixture, parts: tuple[Dataset, Dataset]) -> None:
    assert mixture.id == "coop_nav-tiny-v0+coop_nav-other-v0"
    found = json.loads(mixture.view)["mixture"]
    assert [(each["id"], each["digest"], each["weight"]) for each in found] == [
        (part.id, part.digest, weight) for part, weight in zip(parts, WEIGHTS, strict=True)
    ]
    assert mixture.digest != mix(parts, [7, 3]).digest
    assert len(mixture.digest) == 64


def test_what_a_part_did_not_record_is_in_no_batch(tmp_path: Path) -> None:
    """It was in those batches whose rows all came from the other part."""
    both = []
    for name, has_log_probs in (("with", True), ("without", False)):
        options: dict[str, Any] = {"id": f"counting_v1-{name}-v0", "log_probs": has_log_probs}
        with Recorder(Counting(), path=tmp_path / name, **options) as recorder:
            for _ in range(5):
                recorder.reset()
                while recorder.agents:
                    if has_log_probs:
                        recorder.record_log_probs(dict.fromkeys(recorder.agents, -0.5))
                    recorder.step({agent: steady(agent, 0) for agent in recorder.agents})
        both.append(recorder.close())
    for mixture in (mix(both), load([part.path for part in both], stream=True)):
        assert mixture.sampler(2).gather(np.array([0, 1])).log_probs is None


def test_sides_are_those_of_the_parts(parts: tuple[Dataset, Dataset], tmp_path: Path) -> None:
    spec = preset("tag").with_updates(horizon=20)
    team = (PolicySource(label="a", name="random"),)
    made: dict[str, Any] = {"id": "tag-tiny-v0", "spec": spec, "policies": team, "n_steps": 80}
    path = make_tiny(tmp_path / "tag", **made)
    sides = load([path, path], weights=[3, 1]).side("pursuers")
    assert sides.digest == load([path, path], weights=[3, 1], side="pursuers").digest
    assert next(sides.sampler(4)).actions.shape == (4, 3, 2)
    with pytest.raises(SpecError, match="one side"):
        mix(parts).side("pursuers")
    with pytest.raises(SchemaError, match="Load it without stream=True"):
        load([path, path], stream=True).side("pursuers")


def test_a_policy_is_of_those_parts_that_know_it(tmp_path: Path, tiny: Path) -> None:
    team = (PolicySource(label="other", name="random"),)
    made = make_tiny(tmp_path / "other", id="coop_nav-other-v0", policies=team)
    both = mix([Dataset.open(tiny), Dataset.open(made)])
    assert [part.id for part in both.filter(policy="other").parts] == ["coop_nav-other-v0"]
    with pytest.raises(UnknownNameError, match="nobody"):
        both.filter(policy="nobody")


def test_a_part_without_episodes_is_left_out(mixture: Mixture) -> None:
    best = max(episode.team_return for episode in mixture.parts[0])
    kept = mixture.filter(min_return=best)
    expected = [part for part in mixture.parts if (part.episodes.team_return >= best).any()]
    assert len(kept.parts) == len(expected)
    assert sum(kept.weights) == pytest.approx(1.0)
    with pytest.raises(SchemaError, match=r"their team returns are .* to .*\. Widen the filter"):
        mixture.filter(min_return=1e9)


def test_wrong_mixtures_are_refused(parts: tuple[Dataset, Dataset], tmp_path: Path) -> None:
    spec = TINY.spec.with_updates(horizon=20)
    shorter = Dataset.open(make_tiny(tmp_path / "short", id="coop_nav-short-v0", spec=spec))
    with pytest.raises(SchemaError, match="their specs differ in horizon"):
        mix([parts[0], shorter])
    for weights in ([1], [1, 0], [1, float("inf")]):
        with pytest.raises(SpecError, match="a positive number for each of its 2 datasets"):
            mix(parts, weights)
    with pytest.raises(SchemaError, match="there are no datasets"):
        mix([])
    with pytest.raises(SchemaError, match="coop_nav-tiny-v0 has no episodes to mix"):
        mix([parts[0].filter(min_return=1e9), parts[1]], [1, 1])
    with pytest.raises(SpecError, match="expected at most 96"):
        mix([parts[0]] * 6)
