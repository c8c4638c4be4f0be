"""Bags hold every array exactly, and what robots would log, read back by rosbags and mcap."""

import json
import math
from collections.abc import Callable
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from swarmdata.datasets.dataset import Dataset
from swarmdata.envs.physics.dynamics import begin_step, limits_of
from swarmdata.errors import ConversionError
from swarmdata.interop.bags.bag_messages import _robots, command_of
from swarmdata.interop.conversion.dataset_facts import array_names
from swarmdata.interop.export import export_dataset
from swarmdata.interop.logs.import_logs import import_logs
from swarmdata.perception.observer import features_of
from swarmdata.perception.sensing.scans import scan_of
from swarmdata.registry.components import make_task
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.testing.synthetic import make_episode
from swarmdata.types import STEP_FIELDS
from tests.support.pairs import slow
from tests.support.tiny import TINY, make_tiny

pytest.importorskip("rosbags", reason="the extra of bags")
pytest.importorskip("mcap", reason="the extra of bags")

PAGE = Path(__file__).parents[3] / "docs/your-data.md"

Topics = dict[str, list[tuple[int, Any]]]

NAMES = {"mcap": "team.mcap", "rosbag2": "team"}


@pytest.fixture(scope="module")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return Dataset.open(make_tiny(tmp_path_factory.mktemp("tiny") / "tiny", n_steps=100))


@pytest.fixture(scope="module")
def read_back(tmp_path_factory: pytest.TempPathFactory) -> Callable[[Dataset, str], Topics]:
    """Exports a dataset, and reads the bag by rosbags: times and messages of each topic."""

    def export(dataset: Dataset, name: str) -> Topics:
        from rosbags.highlevel import AnyReader

        path = tmp_path_factory.mktemp(name) / NAMES[name]
        export_dataset(dataset, path, format=name)
        topics: Topics = {}
        with AnyReader([path]) as reader:
            for connection, time, data in reader.messages():
                message = reader.deserialize(data, connection.msgtype)
                topics.setdefault(connection.topic, []).append((time, message))
        return topics

    return export


def array_of(message: Any) -> np.ndarray:
    return message.data.reshape([dim.size for dim in message.layout.dim])


def check_arrays(dataset: Dataset, topics: Topics) -> None:
    """All arrays of all episodes, row by row, and when the rows are."""
    step, gap, start = round(1e9 * (dataset.spec.time_step or 1.0)), 10**10, 10**9
    left = {name: iter(topics[f"/team/{name}"]) for name in array_names(dataset)}
    for episode in dataset:
        for name, rows in left.items():
            values = getattr(episode, name)
            late = name in STEP_FIELDS and name not in ("actions", "log_probs")
            late = late or name in ("reward_terms", "agent_terminations", "agent_truncations")
            for k, row in enumerate(values):
                time, message = next(rows)
                assert time == start + step * (k + late), name
                np.testing.assert_array_equal(array_of(message), np.atleast_1d(row), err_msg=name)
        start += step * len(episode) + gap
    assert all(next(rows, None) is None for rows in left.values())


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_every_array_is_there(
    name: str, tiny: Dataset, recorded: Dataset, read_back: Callable[[Dataset, str], Topics]
) -> None:
    view = tiny.filter(policy="b")
    for dataset in (view, recorded):
        topics = read_back(dataset, name)
        check_arrays(dataset, topics)
        facts = [json.loads(message.data) for _, message in topics["/team/episode"]]
        assert [each["episode"] for each in facts] == dataset.selection.tolist()
        assert [each["seed"] for each in facts] == [episode.seed for episode in dataset]
        assert [each["steps"] for each in facts] == [len(episode) for episode in dataset]
    assert set(topics) <= {"/team/episode", *(f"/team/{each}" for each in array_names(recorded))}
    assert not {each["policy"] for each in facts} - {"mine"}


@pytest.mark.parametrize("name", ["mcap", *slow("rosbag2")])
def test_robots_log_what_they_do(
    name: str, tiny: Dataset, read_back: Callable[[Dataset, str], Topics]
) -> None:
    topics = read_back(tiny.split("train"), name)
    episode = tiny.split("train")[0]
    robots = episode.states.reshape(len(episode) + 1, 4, -1)[:, 2]
    for k, (time, message) in enumerate(topics["/robot_2/pose"][: len(robots)]):
        assert time == 10**9 + k * 10**8
        stamp = message.header.stamp
        assert (stamp.sec * 10**9 + stamp.nanosec, message.header.frame_id) == (time, "world")
        place, turn = message.pose.position, message.pose.orientation
        np.testing.assert_array_equal((place.x, place.y), robots[k, :2].astype(float))
        assert (turn.z, turn.w) == (0.0, 1.0), "holonomic robots do not turn"
        velocity = topics["/robot_2/velocity"][k][1].twist.linear
        np.testing.assert_array_equal((velocity.x, velocity.y), robots[k, 2:4].astype(float))
        goal = topics["/robot_2/goal"][k][1].pose.position
        np.testing.assert_array_equal((goal.x, goal.y), robots[k, 6:8].astype(float))
    commands = [message for _, message in topics["/robot_2/command"][: len(episode)]]
    speeds = np.array([(each.twist.linear.x, each.twist.linear.y) for each in commands])
    actions = episode.actions[:, 2].astype(float)
    norm = np.maximum(np.linalg.norm(actions, axis=1, keepdims=True), 1)
    np.testing.assert_allclose(speeds, actions / norm * 0.6, rtol=1e-12)


@pytest.mark.slow
def test_an_mcap_file_says_where_it_comes_from(tiny: Dataset, tmp_path: Path) -> None:
    from mcap.reader import make_reader

    path = export_dataset(tiny, tmp_path / "team.mcap", format="mcap")
    with path.open("rb") as file:
        reader = make_reader(file)
        summary = reader.get_summary()
        assert summary is not None
        assert {each.compression for each in summary.chunk_indexes} == {"zstd"}
        (metadata,) = reader.iter_metadata()
        assert metadata.metadata == {"id": tiny.id, "digest": tiny.digest}
        attached = {each.name: each.data.decode() for each in reader.iter_attachments()}
        count = sum(1 for _ in reader.iter_messages())
    assert count == summary.statistics.message_count
    assert yaml.safe_load(attached["recipe.yaml"])["id"] == tiny.id
    assert json.loads(attached["swarmdata.json"])["digest"] == tiny.digest
    again = export_dataset(tiny, tmp_path / "again.mcap", format="mcap")
    assert again.read_bytes() == path.read_bytes()


def test_a_bag_says_where_it_comes_from(tiny: Dataset, tmp_path: Path) -> None:
    path = export_dataset(tiny, tmp_path / "team", format="rosbag2")
    files = {each.name for each in path.iterdir()}
    assert files == {"metadata.yaml", "team.mcap", "swarmdata.json", "recipe.yaml"}
    facts = yaml.safe_load((path / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert facts["relative_file_paths"] == ["team.mcap"]
    assert facts["custom_data"] == {"swarmdata_id": tiny.id, "swarmdata_digest": tiny.digest}


@pytest.mark.parametrize(
    ("dynamics", "command", "drive"),
    [
        *product(["holonomic", "unicycle"], ["velocity", "acceleration"], ["independent"]),
        ("unicycle", "velocity", "differential"),
    ],
)
def test_commands_are_those_of_the_world(dynamics: str, command: str, drive: str) -> None:
    """Clipped as the world clips them, in SI units, as velocities or accelerations."""
    body = {"dynamics": dynamics, "command": command, "drive": drive}
    team = [{"name": "robot", "count": 4, "robot": body}]
    world = TaskSpec.model_validate({**TINY.spec.model_dump(), "team": team})
    n, flags, times = world.n_agents, np.zeros(1, np.bool_), np.zeros(1, np.int64)
    actions, clipped = np.random.default_rng(0).normal(0, 1, (1, n, 2)), np.zeros((1, n, 2))
    states = np.zeros((1, 8 * n), np.float32)
    begin_step(
        limits_of(world), flags.copy(), clipped, actions, flags, flags, times, states,
        times.copy(), states.copy(), np.zeros((1, n, 4), np.uint8),
    )  # fmt: skip
    robot = world.robots[0]
    most = robot.max_speed if command == "velocity" else robot.max_acceleration
    scale = (most, robot.max_turn_rate) if dynamics == "unicycle" else (most, most)
    found = np.stack([command_of(world, i, actions[0, i]) for i in range(n)])
    np.testing.assert_allclose(found, clipped[0] * scale, rtol=1e-12)
    episode = make_episode(3, 0, n_agents=n, n_states=8 * n)
    sent = {message.topic: message.fields for message in _robots(world, (), episode, 0, 0)}
    first = command_of(world, 1, episode.actions[0, 1].astype(float))
    is_unicycle = dynamics == "unicycle"
    assert ("/robot_1/command" in sent) == (command == "velocity" or is_unicycle)
    assert ("/robot_1/acceleration" in sent) == (command == "acceleration")
    key, field = ("command", "twist") if command == "velocity" else ("acceleration", "accel")
    fields = sent[f"/robot_1/{key}"]
    assert fields["header"]["frame_id"] == ("robot_1" if is_unicycle else "world")
    linear = fields[field]["linear"]
    assert (linear["x"], linear["y"]) == (first[0], 0.0 if is_unicycle else first[1])
    if is_unicycle:
        assert sent["/robot_1/command"]["twist"]["angular"]["z"] == first[1]


@pytest.mark.slow
def test_scans_are_in_metres(tiny: Dataset, read_back: Callable[[Dataset, str], Topics]) -> None:
    seen = tiny.split("train").reobserve(observation="lidar-16")
    episode = seen[0]
    (_, first), *_ = read_back(seen, "mcap")["/robot_0/scan"]
    assert (first.range_max, first.header.frame_id) == (2.0, "robot_0")
    assert first.angle_increment == pytest.approx(2 * math.pi / 16)
    shares = scan_of(features_of(make_task(seen.task)), episode.observations[0])
    assert shares is not None
    shares = shares[0]
    np.testing.assert_array_equal(np.isinf(first.ranges), shares == 1)
    np.testing.assert_allclose(first.ranges[shares < 1], 2 * shares[shares < 1], rtol=1e-6)


@pytest.mark.parametrize("name", ["rosbag2", *slow("mcap")])
def test_a_bag_is_imported_as_a_log(name: str, tiny: Dataset, tmp_path: Path) -> None:
    """With the last map of docs/your-data.md: the same poses, goals and commands, step by step."""
    text = PAGE.read_text(encoding="utf-8").rpartition("```yaml\n")[2].partition("```")[0]
    (tmp_path / "team.yaml").write_text(text)
    path = export_dataset(tiny, tmp_path / NAMES[name], format=name)
    logged = import_logs(
        path, tmp_path / "logged", log_map=tmp_path / "team.yaml", id="coop_nav-logged-v0"
    )
    np.testing.assert_array_equal(logged.episodes.lengths, tiny.episodes.lengths)
    for mine, theirs in zip(logged, tiny, strict=True):
        robots = theirs.states.reshape(len(theirs) + 1, 4, -1)
        np.testing.assert_allclose(mine.observations[..., :2], robots[..., 6:8], atol=1e-6)
        np.testing.assert_allclose(mine.observations[..., 3:5], robots[..., :2], atol=1e-6)
        norm = np.maximum(np.linalg.norm(theirs.actions, axis=-1, keepdims=True), 1)
        np.testing.assert_allclose(mine.actions, 0.6 * theirs.actions / norm, atol=1e-6)


@pytest.mark.parametrize("name", NAMES)
def test_turned_actions_are_refused(name: str, tiny: Dataset, tmp_path: Path) -> None:
    with pytest.raises(ConversionError, match=r"got frame='target'\. Leave --frame out"):
        export_dataset(tiny, tmp_path / NAMES[name], format=name, frame="target")
    assert not list(tmp_path.iterdir())
