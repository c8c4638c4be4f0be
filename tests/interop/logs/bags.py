"""Writes bags of four robots: Odometry, Twist and LaserScan, and static transforms."""

import json
from pathlib import Path
from typing import Any

import numpy as np

ROBOTS = ("robot_0", "robot_1", "robot_2", "robot_3")
START = 1_700_000_000 * 10**9  # ns
SPEED, TURN = 0.3, 0.4  # m/s, rad/s

MAP: dict[str, Any] = {
    "dt": 0.1,
    "world": "map",
    "each": {
        "pose": {"topic": "/{robot}/odom"},
        "command": {
            "topic": "/{robot}/cmd_vel",
            "components": [
                {"column": "v", "low": -0.5, "high": 0.5},
                {"column": "omega", "low": -1, "high": 1},
            ],
        },
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


class Messages:
    """Messages of one distribution of ROS."""

    def __init__(self, store: Any) -> None:
        self.store, self._types = store, store.types

    def make(self, name: str, **fields: Any) -> Any:
        return self._types[name](**fields)

    def header(self, ns: int, frame: str) -> Any:
        stamp = self.make(
            "builtin_interfaces/msg/Time", sec=int(ns // 10**9), nanosec=int(ns % 10**9)
        )
        fields = {"stamp": stamp, "frame_id": frame}
        kind = self._types["std_msgs/msg/Header"]
        if "seq" in kind.__dataclass_fields__:
            fields["seq"] = 0
        return kind(**fields)

    def vector(self, x: float = 0.0, z: float = 0.0) -> Any:
        return self.make("geometry_msgs/msg/Vector3", x=x, y=0.0, z=z)

    def turned(self, yaw: float) -> Any:
        return self.make(
            "geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=np.sin(yaw / 2), w=np.cos(yaw / 2)
        )

    def twist(self, v: float, omega: float) -> Any:
        return self.make(
            "geometry_msgs/msg/Twist", linear=self.vector(x=v), angular=self.vector(z=omega)
        )

    def odometry(self, ns: int, frame: str, x: float, y: float, yaw: float) -> Any:
        point = self.make("geometry_msgs/msg/Point", x=x, y=y, z=0.0)
        pose = self.make("geometry_msgs/msg/Pose", position=point, orientation=self.turned(yaw))
        nothing = np.zeros(36)
        return self.make(
            "nav_msgs/msg/Odometry",
            header=self.header(ns, frame),
            child_frame_id="base_link",
            pose=self.make("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=nothing),
            twist=self.make(
                "geometry_msgs/msg/TwistWithCovariance",
                twist=self.twist(0.0, 0.0),
                covariance=nothing,
            ),
        )

    def scan(self, ns: int, ranges: np.ndarray) -> Any:
        return self.make(
            "sensor_msgs/msg/LaserScan", header=self.header(ns, "laser"), angle_min=0.0,
            angle_max=6.0, angle_increment=0.5, time_increment=0.0, scan_time=0.1, range_min=0.1,
            range_max=3.5, ranges=ranges.astype(np.float32), intensities=np.zeros(0, np.float32),
        )  # fmt: skip

    def transforms(self, frames: dict[str, tuple[float, float, float]]) -> Any:
        """Frames in `map` by name: x, y, heading."""
        made = [
            self.make(
                "geometry_msgs/msg/TransformStamped",
                header=self.header(START, "map"),
                child_frame_id=name,
                transform=self.make(
                    "geometry_msgs/msg/Transform",
                    translation=self.make("geometry_msgs/msg/Vector3", x=x, y=y, z=0.0),
                    rotation=self.turned(heading),
                ),
            )
            for name, (x, y, heading) in frames.items()
        ]
        return self.make("tf2_msgs/msg/TFMessage", transforms=made)


def team(messages: Messages, seconds: float) -> list[tuple[str, str, int, Any]]:
    """Topic, type, time and message of everything that four robots log, in the order of time."""
    found: list[tuple[str, str, int, Any]] = []
    frames = {f"{name}/odom": (float(k), 0.5 * k, 0.1 * k) for k, name in enumerate(ROBOTS)}
    found.append(("/tf_static", "tf2_msgs/msg/TFMessage", START, messages.transforms(frames)))
    for number, name in enumerate(ROBOTS):
        drive = states(number, seconds)
        for k, ns in enumerate((START + drive["ns"]).tolist()):
            x, y, yaw = (float(drive[key][k]) for key in ("x", "y", "yaw"))
            odometry = messages.odometry(ns, f"{name}/odom", x, y, yaw)
            found.append((f"/{name}/odom", "nav_msgs/msg/Odometry", ns + 1000, odometry))
            speed = SPEED * (1 + 0.2 * np.sin(k / 20))
            twist = messages.twist(speed, TURN)
            found.append((f"/{name}/cmd_vel", "geometry_msgs/msg/Twist", ns, twist))
            if k % 2 == 0:
                ranges = np.array([1.0, np.inf, 2.0 + number, 9.0] * 2)
                scan = messages.scan(ns, ranges)
                found.append((f"/{name}/scan", "sensor_msgs/msg/LaserScan", ns, scan))
    return sorted(found, key=lambda each: each[2])


def write_ros2(path: Path, *, storage: str, seconds: float = 60.0) -> Path:
    """A bag of ROS 2, `mcap` or `sqlite3`."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    messages = Messages(get_typestore(Stores.ROS2_HUMBLE))
    with Writer(path, version=9, storage_plugin=StoragePlugin[storage.upper()]) as writer:
        _write(writer, messages, seconds, messages.store.serialize_cdr)
    return path


def write_ros1(path: Path, seconds: float = 60.0) -> Path:
    """A bag of ROS 1."""
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    definition = "geometry_msgs/TransformStamped[] transforms"
    store.register(get_types_from_msg(definition, "tf2_msgs/msg/TFMessage"))
    messages = Messages(store)
    with Writer(path) as writer:
        _write(writer, messages, seconds, messages.store.serialize_ros1)
    return path


def _write(writer: Any, messages: Messages, seconds: float, serialize: Any) -> None:
    connections = {}
    for topic, kind, ns, message in team(messages, seconds):
        if topic not in connections:
            connections[topic] = writer.add_connection(topic, kind, typestore=messages.store)
        writer.write(connections[topic], ns, serialize(message, kind))


def write_json(path: Path, seconds: float = 60.0) -> Path:
    """An MCAP file of Foxglove's JSON messages: poses, and commands by their parts."""
    from mcap.writer import Writer

    with path.open("wb") as file:
        writer = Writer(file)
        writer.start("", "test")
        schema = writer.register_schema("foxglove.PoseInFrame", "jsonschema", b'{"type":"object"}')
        for number, name in enumerate(ROBOTS):
            drive = states(number, seconds)
            poses = writer.register_channel(f"/{name}/pose", "json", schema)
            commands = writer.register_channel(f"/{name}/command", "json", schema)
            for k, ns in enumerate((START + drive["ns"]).tolist()):
                yaw = float(drive["yaw"][k])
                turn = {"x": 0, "y": 0, "z": np.sin(yaw / 2), "w": np.cos(yaw / 2)}
                place = {"x": drive["x"][k], "y": drive["y"][k], "z": 0}
                pose = {
                    "timestamp": {"sec": ns // 10**9, "nsec": ns % 10**9},
                    "frame_id": "map",
                    "pose": {"position": place, "orientation": turn},
                }
                writer.add_message(poses, ns, json.dumps(pose).encode(), ns)
                command = {"drive": {"speed": SPEED}, "turn": TURN}
                writer.add_message(commands, ns, json.dumps(command).encode(), ns)
        writer.finish()
    return path
