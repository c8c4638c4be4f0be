"""Minari: its own library reads what we write, and we read what it wrote."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gymnasium import spaces

from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import ConversionError
from swarmdata.interop.convert import import_dataset
from swarmdata.interop.export import MisplacedExportWarning, export_dataset
from swarmdata.numerics.random import evaluation_seeds
from swarmdata.types import END_REASONS
from tests.interop.foreign import write_minari

minari = pytest.importorskip("minari", reason="the extra 'minari'")


def test_minari_loads_it_by_name(
    recorded: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    export_dataset(recorded, tmp_path / "root" / recorded.id, format="minari")
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "root"))
    found = minari.load_dataset(recorded.id)
    assert found.total_episodes == len(recorded)
    assert found.total_steps == recorded.n_steps
    for ours, theirs in zip(recorded, found.iterate_episodes(), strict=True):
        assert len(theirs.observations["agent_0"]) == len(theirs.rewards) + 1
        seen = theirs.observations["agent_0"]
        assert seen.dtype == np.float64
        assert found.observation_space["agent_0"].shape == (3,)
        np.testing.assert_array_equal(seen, ours.observations[:, 1, :3])
        np.testing.assert_array_equal(seen[:, 1], np.arange(len(seen)))  # feature 1 is the time
        np.testing.assert_array_equal(theirs.actions["adversary_0"], ours.actions[:, 0, 0])
        choices = found.action_space["adversary_0"]
        assert all(choices.contains(each) for each in theirs.actions["adversary_0"])
        np.testing.assert_allclose(theirs.rewards, ours.rewards.mean(1), rtol=1e-6)
        np.testing.assert_array_equal(theirs.truncations, ours.truncations)


def write_theirs(folder: Path, episodes: list[dict[str, Any]]) -> Path:
    goal, position = spaces.Box(-1, 1, (2,)), spaces.Box(-np.inf, np.inf, (3,))
    space = spaces.Dict({"goal": goal, "position": position})
    return write_minari(folder, episodes, space, spaces.Discrete(4, start=1))


def test_their_images_stay_bytes(tmp_path: Path) -> None:
    made = np.random.default_rng(0).integers(0, 256, (20, 6, 4, 3, 3)).astype(np.uint8)
    episodes = (
        {"observations": each, "actions": np.zeros(5, np.int64), "rewards": np.zeros(5),
         "terminations": np.arange(5) == 4, "truncations": np.zeros(5, bool)}
        for each in made
    )  # fmt: skip
    image = spaces.Box(0, 255, (4, 3, 3), np.uint8)
    write_minari(tmp_path / "pong", episodes, image, spaces.Discrete(3), jpeg_encoding=False)
    taken = import_dataset(tmp_path / "pong", tmp_path / "out", format="minari", id="pong-a-v0")
    for name in ("observations", "states"):
        assert taken.stored.arrays[name].dtype == np.uint8
        np.testing.assert_array_equal(taken.stored.arrays[name].reshape(made.shape), made)


def their_episode(number: int, length: int, is_cut: bool) -> dict[str, Any]:
    time = np.arange(length + 1)
    last = np.arange(length) == length - 1
    return {
        "observations": {
            "goal": np.full((length + 1, 2), 0.5, np.float32),
            "position": np.stack([time, np.full_like(time, number), time], 1).astype(np.float32),
        },
        "actions": time[:-1] % 4 + 1,
        "rewards": 100.0 * number + time[:-1],
        "terminations": last & (not is_cut),
        "truncations": last & is_cut,
    }


def test_theirs_is_read_aligned(tmp_path: Path) -> None:
    lengths = [3, 5, 1, 4] * 7
    made = [their_episode(k, n, bool(k % 2)) for k, n in enumerate(lengths)]
    source = write_theirs(tmp_path / "maze", made)
    dataset = import_dataset(source, tmp_path / "out", format="minari", id="maze-theirs-v0")
    assert dataset.episodes.lengths.tolist() == lengths
    assert dataset.spec.agents[0].action.start == 1  # type: ignore[attr-defined]
    for number, episode in enumerate(dataset):
        t = np.arange(len(episode))
        np.testing.assert_array_equal(episode.observations[:, 0, 2], np.arange(len(t) + 1))
        np.testing.assert_array_equal(episode.observations[:, 0, 3], number)
        np.testing.assert_array_equal(episode.actions[:, 0, 0], t % 4 + 1)
        np.testing.assert_array_equal(episode.rewards[:, 0], 100 * number + t)
        assert END_REASONS[episode.end_reason] == ("horizon" if number % 2 else "ended")
    for answer in ({"time_limit": 3}, {"agents": 2}, {"action_low": -1.0}, {"unfinished": "drop"}):
        with pytest.raises(ConversionError, match="Minari says where episodes end"):
            import_dataset(source, tmp_path / "b", format="minari", id="maze-b-v0", **answer)


def test_a_dict_of_agents_is_a_team_if_told(recorded: Dataset, tmp_path: Path) -> None:
    path = export_dataset(recorded, tmp_path / recorded.id, format="minari")
    text = (path / "data/metadata.json").read_text()
    assert '"swarmdata"' in text
    (path / "data/metadata.json").write_text(text.replace('"swarmdata"', '"other"'))

    def read(*agents: str) -> Dataset:
        out = tmp_path / "out"
        return import_dataset(path, out, format="minari", id="tag-b-v0", agents=agents)

    with pytest.raises(ConversionError, match=r"expected the keys of the Dict spaces"):
        read("a", "b")
    back = read("adversary_0", "agent_0")
    for got, expected in zip(back, recorded, strict=True):
        np.testing.assert_array_equal(got.observations, expected.observations)
        np.testing.assert_array_equal(got.actions, expected.actions)


def test_cut_episodes_are_refused(tmp_path: Path) -> None:
    import h5py

    source = write_theirs(tmp_path / "maze", [their_episode(k, 4, False) for k in range(25)])
    with h5py.File(source / "main_data.hdf5", "r+") as file:
        file["episode_3"].attrs["total_steps"] = 40_000
    with pytest.raises(ConversionError, match="episode 3 has 4 steps, but its metadata says 40000"):
        import_dataset(source, tmp_path / "out", format="minari", id="maze-theirs-v0")
    with pytest.raises(ConversionError, match="is not a Minari dataset"):
        import_dataset(tmp_path, tmp_path / "out", format="minari", id="maze-theirs-v0")


@pytest.fixture
def shown(ours: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder in which Minari looks for datasets."""
    root = tmp_path / "root"
    root.mkdir()
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(root))
    return root


def test_an_export_of_another_name_is_invisible_and_says_so(ours: Dataset, shown: Path) -> None:
    with pytest.warns(
        MisplacedExportWarning, match=rf"rename {shown}/mine-v0 to {shown}/{ours.id}"
    ):
        path = export_dataset(ours, shown / "mine-v0", format="minari")
    with pytest.warns(UserWarning, match="Misconfigured dataset named mine-v0"):
        assert minari.list_local_datasets() == {}
    path.rename(path.with_name(ours.id))
    assert list(minari.list_local_datasets()) == [ours.id]


@pytest.mark.parametrize("models", [("state", "none"), ("lidar", "lossy-30")])
def test_the_recovered_world_replays_every_episode(
    models: tuple[str, str], tiny: Path, shown: Path
) -> None:
    """Same seed, same actions: the same observations, rewards and ends, bit for bit."""
    dataset = Dataset.open(tiny).reobserve(*models)
    dataset = dataset.with_rewards(robot_collision=7.0)
    export_dataset(dataset, shown / dataset.id, format="minari")
    found = minari.load_dataset(dataset.id)
    env = found.recover_environment()
    assert env.observation_space == found.observation_space
    assert env.action_space == found.action_space
    facts = found.storage.get_episode_metadata(found.episode_indices)
    for episode, fact in zip(found.iterate_episodes(), facts, strict=True):
        observations, _ = env.reset(seed=int(fact["seed"]))
        for t in range(len(episode)):
            for name, seen in observations.items():
                np.testing.assert_array_equal(seen, episode.observations[name][t])
            actions = {name: rows[t] for name, rows in episode.actions.items()}
            observations, reward, terminated, truncated, info = env.step(actions)
            assert reward == episode.rewards[t]
            assert terminated == episode.terminations[t]
            assert truncated == episode.truncations[t]
            np.testing.assert_array_equal(info["states"], episode.infos["states"][t + 1])
        for name, seen in observations.items():
            np.testing.assert_array_equal(seen, episode.observations[name][-1])


def test_the_recovered_world_of_evaluation_is_the_task(tiny: Path, shown: Path) -> None:
    """It has the task's own rewards, and plays the reserved evaluation episodes."""
    dataset = Dataset.open(tiny).with_rewards(robot_collision=7.0)
    export_dataset(dataset, shown / dataset.id, format="minari")
    found = minari.load_dataset(dataset.id)
    played, recorded = found.recover_environment(eval_env=True), found.recover_environment()
    assert played.unwrapped.task == dataset.task
    assert recorded.unwrapped.task.rules.rewards.robot_collision == 7.0
    observations, _ = played.reset()
    expected, _ = recorded.reset(seed=int(evaluation_seeds(1)[0]))
    for name, seen in observations.items():
        np.testing.assert_array_equal(seen, expected[name])


def test_a_turned_export_recovers_a_world_in_its_frame(tiny: Path, shown: Path) -> None:
    """Up to the rounding of the turned actions, which turn back to the recorded ones."""
    dataset = Dataset.open(tiny)
    export_dataset(dataset, shown / dataset.id, format="minari", frame="target")
    found = minari.load_dataset(dataset.id)
    env, episode = found.recover_environment(), found[0]
    assert env.observation_space == found.observation_space
    observations, _ = env.reset(seed=dataset[0].seed)
    for t in range(3):
        for name, seen in observations.items():
            np.testing.assert_allclose(seen, episode.observations[name][t], atol=1e-4)
        actions = {name: rows[t] for name, rows in episode.actions.items()}
        observations, *_ = env.step(actions)


def test_environments_of_others_are_not_recovered(recorded: Dataset, shown: Path) -> None:
    export_dataset(recorded, shown / recorded.id, format="minari")
    with pytest.raises(ValueError, match="env_spec is None"):
        minari.load_dataset(recorded.id).recover_environment()
