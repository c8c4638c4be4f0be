"""Bags of four robots, written by `rosbags` and `mcap`: the same data in every kind of bag."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from swarmdata.audit import audit
from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import ConversionError
from swarmdata.interop.logs.bag_tables import read_bag
from swarmdata.interop.logs.import_logs import import_logs
from swarmdata.specs.origins.log_map import LogMap
from tests.interop.logs import bags
from tests.support.pairs import slow

pytest.importorskip("rosbags", reason="the extra 'logs'")
pytest.importorskip("mcap", reason="the extra 'logs'")

ID = "hall-bags-v0"


def make(log: Path, out: Path, **changes: Any) -> Dataset:
    return import_logs(log, out, log_map=LogMap.parse({**bags.MAP, **changes}), id=ID)


@pytest.fixture(scope="module")
def from_mcap(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    folder = tmp_path_factory.mktemp("mcap")
    return make(bags.write_ros2(folder / "monday", storage="mcap"), folder / "dataset")


@pytest.mark.slow
def test_four_robots_in_mcap(from_mcap: Dataset) -> None:
    assert audit(from_mcap.path, progress=False).problems == ()
    assert from_mcap.spec.agent_names == bags.ROBOTS
    assert [len(episode) for episode in from_mcap][:3] == [30, 30, 30]
    episode = from_mcap[2]
    assert episode.alive is None
    t = 2 * 3.1 + 0.1 * np.arange(31)
    for number in range(4):
        yaw = bags.TURN * t + number
        x, y = bags.SPEED / bags.TURN * np.sin(yaw), -bags.SPEED / bags.TURN * np.cos(yaw)
        cosine, sine, heading = np.cos(0.1 * number), np.sin(0.1 * number), yaw + 0.1 * number
        pose = np.stack([number + cosine * x - sine * y, 0.5 * number + sine * x + cosine * y,
                         np.cos(heading), np.sin(heading)], axis=1)  # fmt: skip
        assert_allclose(episode.observations[:, number, :4], pose, atol=1e-4)
        scan = [1.0, 2.0 + number if number < 2 else 3.5] * 2
        assert_allclose(episode.observations[3, number, 4:], [*scan, 1.0])
    assert_allclose(episode.actions[..., 1], bags.TURN)
    k = np.round(t[:-1] * 20)
    assert_allclose(episode.actions[:, 0, 0], bags.SPEED * (1 + 0.2 * np.sin(k / 20)), rtol=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["ros1", *slow("sqlite3", "file")])
def test_other_bags_hold_the_same(kind: str, from_mcap: Dataset, tmp_path: Path) -> None:
    if kind == "ros1":
        log = bags.write_ros1(tmp_path / "monday.bag")
    elif kind == "sqlite3":
        log = bags.write_ros2(tmp_path / "monday", storage=kind)
    else:  # without its metadata
        (log,) = bags.write_ros2(tmp_path / "monday", storage="mcap").glob("*.mcap")
    assert make(log, tmp_path / "dataset").digest == from_mcap.digest


@pytest.mark.slow
def test_json_in_mcap(tmp_path: Path) -> None:
    log = bags.write_json(tmp_path / "monday.mcap")
    command = {
        "topic": "/{robot}/command",
        "components": [
            {"column": "drive.speed", "low": 0, "high": 1},
            {"column": "turn", "low": -1, "high": 1},
        ],
    }
    signals = {"pose": {"topic": "/{robot}/pose"}, "command": command}
    dataset = make(log, tmp_path / "dataset", each=signals)
    assert audit(dataset.path, progress=False).problems == ()
    assert_allclose(dataset[0].actions[:, 2], np.tile([bags.SPEED, bags.TURN], (30, 1)))
    assert_allclose(dataset[0].observations[0, 2, 2:], [np.cos(2), np.sin(2)], atol=1e-6)


def test_times_frames_and_what_was_not_read(tmp_path: Path) -> None:
    log = bags.write_ros2(tmp_path / "monday", storage="mcap", seconds=1.0)
    found = read_bag(log, {"/robot_0/odom"})
    assert found.tables.keys() == {"/robot_0/odom"}
    assert "/robot_3/scan" in found.unread
    assert len(found.unread) == 11
    table = found.tables["/robot_0/odom"]
    assert table.frame == "robot_0/odom"
    assert_allclose(table.numbers("log_time") - table.numbers("time"), 1000)
    assert [each.frame for each in found.transforms] == [f"{name}/odom" for name in bags.ROBOTS]


def test_a_topic_that_is_not_there(tmp_path: Path) -> None:
    log = bags.write_ros2(tmp_path / "monday", storage="mcap", seconds=1.0)
    with pytest.raises(ConversionError, match=r"no topic /robot_0/odm .*Did you mean '/robot_0/od"):
        make(log, tmp_path / "a", each={**bags.MAP["each"], "pose": {"topic": "/{robot}/odm"}})
    with pytest.raises(ConversionError, match="pose of robot_0 has no topic"):
        make(log, tmp_path / "a", each={**bags.MAP["each"], "pose": {}})
