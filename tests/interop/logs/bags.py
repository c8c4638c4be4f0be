"""Writes bags of four robots: Odometry, Twist and LaserScan, and static transforms."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from swarmdata.interop.bags.bag_messages import _header, _pose, _twist, built
from tests.interop.logs.logged_team import bounded

ROBOTS = ("robot_0", "robot_1", "robot_2", "robot_3")
START = 1_700_000_000 * 10**9  # ns
SPEED, TURN = 0.3, 0.4  # m/s, rad/s

MAP: dict[str, Any] = {
    "dt": 0.1,
    "world": "map",
    "each": {
        "pose": {"topic": "/{robot}/odom"},
        "command": {"topic": "/{robot}/cmd_vel", "components": bounded(v=0.5, omega=1)},
        "scan": {"topic": "/{robot}/scan", "range_max": 3.5, "beams": 4},
    },
    "robots": list(ROBOTS),
    "episodes": {"length": 3.0},
}


def states(robot: int, seconds: float) -> dict[str, np.ndarray]:
    """The drive of a robot at 20 Hz: on a circle, in a frame of its own."""
    t = np.arange(round(seconds * 20)) / 20
    yaw = TURN * t + robot
    return {"ns": np.round(t * 1e9).astype(np.int64), "x": SPEED / TURN * np.sin(yaw),
            "y": -SPEED / TURN * np.cos(yaw), "yaw": yaw}  # fmt: skip


def transforms() -> dict[str, Any]:
    """A frame of each robot, in `map`."""
    found = []
    for k, name in enumerate(ROBOTS):
        pose = _pose(float(k), 0.5 * k, np.cos(0.1 * k), np.sin(0.1 * k))
        transform = {"translation": pose["position"], "rotation": pose["orientation"]}
        frame = {"header": {"seq": 0, **_header(START, "map")}, "child_frame_id": f"{name}/odom"}
        found.append({**frame, "transform": transform})
    return {"transforms": found}


def team(types: Any, seconds: float) -> list[tuple[str, str, int, Any]]:
    """Topic, type, time and message of all that four robots log, by time; ROS 1 numbers headers."""
    found: list[tuple[str, str, int, Any]] = [
        ("/tf_static", "tf2_msgs/msg/TFMessage", START, transforms())
    ]
    nothing = np.zeros(36)
    for number, name in enumerate(ROBOTS):
        drive = states(number, seconds)
        for k, ns in enumerate((START + drive["ns"]).tolist()):
            x, y, yaw = (float(drive[key][k]) for key in ("x", "y", "yaw"))
            odometry = {
                "header": {"seq": 0, **_header(ns, f"{name}/odom")},
                "child_frame_id": "base_link",
                "pose": {"pose": _pose(x, y, np.cos(yaw), np.sin(yaw)), "covariance": nothing},
                "twist": {"twist": _twist(0.0, 0.0, 0.0), "covariance": nothing},
            }
            found.append((f"/{name}/odom", "nav_msgs/msg/Odometry", ns + 1000, odometry))
            twist = _twist(SPEED * (1 + 0.2 * np.sin(k / 20)), 0.0, TURN)
            found.append((f"/{name}/cmd_vel", "geometry_msgs/msg/Twist", ns, twist))
            if k % 2 == 0:
                scan = {
                    "header": {"seq": 0, **_header(ns, "laser")}, "angle_min": 0.0,
                    "angle_max": 6.0, "angle_increment": 0.5, "time_increment": 0.0,
                    "scan_time": 0.1, "range_min": 0.1, "range_max": 3.5,
                    "ranges": np.array([1.0, np.inf, 2.0 + number, 9.0] * 2, np.float32),
                    "intensities": np.zeros(0, np.float32),
                }  # fmt: skip
                found.append((f"/{name}/scan", "sensor_msgs/msg/LaserScan", ns, scan))
    messages = [(topic, kind, ns, built(types, kind, each)) for topic, kind, ns, each in found]
    return sorted(messages, key=lambda each: each[2])


def write_ros2(path: Path, *, storage: str, seconds: float = 60.0) -> Path:
    """A bag of ROS 2, `mcap` or `sqlite3`."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    types = get_typestore(Stores.ROS2_HUMBLE)
    with Writer(path, version=9, storage_plugin=StoragePlugin[storage.upper()]) as writer:
        write_team(writer, types, seconds, types.serialize_cdr)
    return path


def write_ros1(path: Path, seconds: float = 60.0) -> Path:
    """A bag of ROS 1."""
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    types = get_typestore(Stores.ROS1_NOETIC)
    definition = "geometry_msgs/TransformStamped[] transforms"
    types.register(get_types_from_msg(definition, "tf2_msgs/msg/TFMessage"))
    with Writer(path) as writer:
        write_team(writer, types, seconds, types.serialize_ros1)
    return path


def write_team(writer: Any, types: Any, seconds: float, serialize: Any) -> None:
    connections = {}
    for topic, kind, ns, message in team(types, seconds):
        if topic not in connections:
            connections[topic] = writer.add_connection(topic, kind, typestore=types)
        writer.write(connections[topic], ns, serialize(message, kind))


def write_messages(path: Path, *messages: tuple[Any, ...], **options: Any) -> Path:
    """An MCAP file of messages: topic, encoding, content, and time; each second by default."""
    from mcap.writer import Writer

    with path.open("wb") as file:
        writer = Writer(file, **options)
        writer.start("", "test")
        schema = writer.register_schema("any", "jsonschema", b"{}")
        channels: dict[tuple[str, str], int] = {}
        for k, (topic, encoding, content, *times) in enumerate(messages, 1):
            if (topic, encoding) not in channels:
                channels[topic, encoding] = writer.register_channel(topic, encoding, schema)
            (time,) = times or [10**9 * k]
            writer.add_message(channels[topic, encoding], time, content, time)
        writer.finish()
    return path


def write_json(path: Path, seconds: float = 60.0) -> Path:
    """An MCAP file of Foxglove's JSON messages: poses, and commands by their parts."""
    messages = []
    command = json.dumps({"drive": {"speed": SPEED}, "turn": TURN}).encode()
    for number, name in enumerate(ROBOTS):
        drive = states(number, seconds)
        for k, ns in enumerate((START + drive["ns"]).tolist()):
            x, y, yaw = (float(drive[key][k]) for key in ("x", "y", "yaw"))
            pose = {
                "timestamp": {"sec": ns // 10**9, "nsec": ns % 10**9},
                "frame_id": "map",
                "pose": _pose(x, y, np.cos(yaw), np.sin(yaw)),
            }
            messages.append((f"/{name}/pose", "json", json.dumps(pose).encode(), ns))
            messages.append((f"/{name}/command", "json", command, ns))
    return write_messages(path, *messages)
