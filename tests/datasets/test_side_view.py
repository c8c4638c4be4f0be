"""One side of a dataset: its rows are those of the whole, and everything takes them."""

import pickle
from pathlib import Path

import numpy as np
import pytest

import swarmdata
from swarmdata.errors import SchemaError, SpecError, UnknownNameError
from swarmdata.registry.presets import preset
from swarmdata.rollouts.side_policy import AGENT_ARRAYS, PAIR_ARRAYS, episode_of_side
from swarmdata.specs.model_choice import with_models
from swarmdata.specs.origins import SideSpec
from swarmdata.specs.recipe import PolicySource
from tests.support.tiny import make_tiny

SPEC = with_models(preset("tag"), communication="perfect").with_updates(horizon=130)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> swarmdata.Dataset:
    """Radios are on, so that every array has a row for each robot."""
    folder = tmp_path_factory.mktemp("sides") / "tag-tiny-v0"
    team = (PolicySource(label="a", name="scripted"),)
    made = make_tiny(folder, id="tag-tiny-v0", spec=SPEC, policies=team, n_steps=2600)
    return swarmdata.Dataset.open(made)


@pytest.mark.parametrize(("name", "agents"), [("pursuers", [0, 1, 2]), ("evader", [3])])
def test_rows_are_those_of_the_whole(
    whole: swarmdata.Dataset, name: str, agents: list[int]
) -> None:
    side = whole.side(name)
    for own, episode in zip(side, whole, strict=True):
        for array in AGENT_ARRAYS:
            expected = getattr(episode, array)[:, agents]
            np.testing.assert_array_equal(getattr(own, array), expected)
        for array in PAIR_ARRAYS:
            expected = getattr(episode, array)[:, agents][:, :, agents]
            np.testing.assert_array_equal(getattr(own, array), expected)
        np.testing.assert_array_equal(own.states, episode.states)
        np.testing.assert_array_equal(own.truncations, episode.truncations)
        again = episode_of_side(episode, SPEC.side(name))
        assert (again.team_return, again.success) == (own.team_return, own.success)
        assert own.success == (episode.success == (name == "pursuers"))
    np.testing.assert_array_equal(
        side.episodes.team_return, [episode.team_return for episode in side]
    )
    np.testing.assert_array_equal(side.episodes.success, [episode.success for episode in side])
    assert len(side.filter(success=True)) + len(whole.filter(success=name != "pursuers")) == len(
        whole
    )
    assert set(side.episodes.success) == {True, False}


def test_batches_transitions_and_moments_are_of_the_side(whole: swarmdata.Dataset) -> None:
    side, train = whole.side("pursuers"), whole.split("train")
    every = train.transitions()
    own = side.split("train").transitions()
    np.testing.assert_array_equal(own["next_observations"], every["next_observations"][:, :3])
    np.testing.assert_array_equal(own["states"], every["states"])
    batch, seen = (next(each.sampler(32, seed=1)) for each in (side, whole))
    for field in ("observations", "actions", "rewards", "next_actions", "log_probs", "costs"):
        np.testing.assert_array_equal(getattr(batch, field), getattr(seen, field)[:, :3])
    windows = next(side.sampler(4, horizon=8, seed=1))
    assert windows.observations.shape[:3] == (4, 8, 3)
    assert side.moments.reward_mean == pytest.approx(own["rewards"].mean(dtype=np.float64))
    observed = np.concatenate([rows for (rows,) in side.split("train").read("observations")])
    np.testing.assert_allclose(
        side.moments.observation_mean, observed.mean((0, 1), dtype=np.float64), atol=1e-6
    )
    assert side.moments.reward_mean != whole.moments.reward_mean


def test_a_side_names_itself_and_travels(whole: swarmdata.Dataset) -> None:
    side = whole.side("evader").split("train")
    assert isinstance(side.spec, SideSpec)
    assert (side.spec.n_agents, side.spec.agent_names) == (1, ("evader_0",))
    assert side.spec.observation_size == whole[0].observations.shape[2]
    assert SideSpec.from_text(side.spec.to_json()) == side.spec
    assert side.spec.task == "tag: evader"
    assert side.view == '{"side":"evader"}'
    assert "the evader alone" in repr(side)
    assert side.task == whole.task
    copied = pickle.loads(pickle.dumps(side))
    np.testing.assert_array_equal(copied.selection, side.selection)
    np.testing.assert_array_equal(copied[0].actions, side[0].actions)
    loaded, own = swarmdata.load(whole.path, side="evader"), whole.side("evader")
    np.testing.assert_array_equal(loaded.episodes.team_return, own.episodes.team_return)


def test_other_views_come_first(whole: swarmdata.Dataset) -> None:
    seen = whole.reobserve("lidar", progress=False).with_rewards(progress=2.0).side("pursuers")
    assert seen[0].observations.shape[1] == 3
    rewards = whole.with_rewards(progress=2.0)[0].rewards
    np.testing.assert_array_equal(seen[0].rewards, rewards[:, :3])
    copied = pickle.loads(pickle.dumps(seen))
    np.testing.assert_array_equal(copied[0].observations, seen[0].observations)
    side = whole.side("pursuers")
    with pytest.raises(SchemaError, match=r"^reobserve needs the rows of all agents"):
        side.reobserve("lidar")
    with pytest.raises(SchemaError, match=r"^with_rewards needs the rows of all agents"):
        side.with_rewards(progress=2.0)
    with pytest.raises(SchemaError, match=r"^side needs the rows of all agents"):
        side.side("evader")
    with pytest.raises(SpecError, match="is one side, which is in no file"):
        swarmdata.combine_datasets([side], Path("unused"), id="tag-other-v0")


def test_the_returns_of_a_side_have_no_score(whole: swarmdata.Dataset) -> None:
    with pytest.raises(SchemaError, match="others played against it"):
        whole.side("pursuers").normalized_score([1.0])


def test_sides_that_do_not_exist_are_refused(whole: swarmdata.Dataset, tiny: Path) -> None:
    with pytest.raises(UnknownNameError, match="unknown side 'hunters'"):
        whole.side("hunters")
    other = swarmdata.Dataset.open(tiny)
    with pytest.raises(SpecError, match="coop_nav has one side, got side 'pursuers'"):
        other.side("pursuers")
    with pytest.raises(SpecError, match="stream does not go with side"):
        swarmdata.load(whole.path, stream=True, side="evader")  # type: ignore[call-overload]
