"""Topics of bags as tables: ROS 2 (SQLite, MCAP) and ROS 1 by `rosbags`, JSON in MCAP by `mcap`.

No ROS is needed. A message becomes a row, and every number in it a column, named by its path, such
as `twist.linear.x`. What maps need most often has short names too: `x`, `y` and `heading` of a
pose or point, `v`, `vy` and `omega` of a twist, and `time`, the stamp of the header, or else the
time at which the message was written (`log_time`).
"""

import json
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmdata.errors import ConversionError
from swarmdata.interop.logs.log_tables import LogTable
from swarmdata.interop.logs.planar_frames import yaw_of
from swarmdata.runtime.extras import require_extra
from swarmdata.specs.origins.log_map import StaticTransform

BAG_SUFFIXES = (".bag", ".mcap", ".db3")

STATIC_TOPIC = "/tf_static"

MOST_TILT = 1e-3
"""Greatest x and y of a static transform's quaternion: frames are turned in the plane only."""

_TIME_UNITS = {"time": "ns", "log_time": "ns"}

Message = tuple[str, int, Any]
"""Topic, time of writing in ns, and the decoded message."""


@dataclass(frozen=True, slots=True, eq=False)
class BagContents:
    """What was read of a bag: tables by topic, static transforms, and the topics left out."""

    tables: Mapping[str, LogTable]
    transforms: tuple[StaticTransform, ...]
    unread: tuple[str, ...]


def is_bag(path: Path) -> bool:
    """Whether this is a bag: a file by its ending, or a folder with the metadata of one."""
    return (path / "metadata.yaml").is_file() if path.is_dir() else path.suffix in BAG_SUFFIXES


def read_bag(path: Path, topics: Collection[str]) -> BagContents:
    """Reads some topics of a bag, and its static transforms.

    Args:
        path: of the bag.
        topics: to read, of those that are there.

    Raises:
        ConversionError: it is no bag, or its messages have no known encoding.
        MissingExtraError: the libraries are not installed.
    """
    for package in ("rosbags", "mcap"):
        require_extra(package, "logs", "reading bags")
    wanted = {*topics, STATIC_TOPIC}
    messages: dict[str, list[tuple[int, Any]]] = {}
    read = _json_messages if _is_json(path) else _ros_messages
    known: set[str] = set()
    for topic, time, message in read(path, wanted, known):
        messages.setdefault(topic, []).append((time, message))
    static = [message for _, message in messages.pop(STATIC_TOPIC, ())]
    tables = {topic: _table(f"{topic} of {path.name}", rows) for topic, rows in messages.items()}
    unread = sorted(known - tables.keys() - {STATIC_TOPIC})
    return BagContents(tables, tuple(_transforms(static)), tuple(unread))


def _is_json(path: Path) -> bool:
    """Whether this is an MCAP file of JSON messages.

    Raises:
        ConversionError: it is an MCAP file of another encoding than these and that of ROS 2.
    """
    if path.suffix != ".mcap":
        return False
    from mcap.exceptions import McapError  # noqa: PLC0415  (an extra)
    from mcap.reader import make_reader  # noqa: PLC0415

    try:
        with path.open("rb") as file:
            summary = make_reader(file).get_summary()
    except McapError as error:
        raise ConversionError(f"{path} is not an MCAP file: {error}") from error
    channels = () if summary is None else summary.channels.values()
    encodings = {channel.message_encoding for channel in channels}
    if encodings - {"json"} and encodings - {"cdr"}:
        raise ConversionError(
            f"{path} has messages in the encodings {', '.join(sorted(encodings))}, expected json "
            "or cdr alone"
        )
    return encodings == {"json"}


def _json_messages(path: Path, wanted: Collection[str], known: set[str]) -> Iterator[Message]:
    from mcap.reader import make_reader  # noqa: PLC0415  (an extra)

    with path.open("rb") as file:
        for _, channel, message in make_reader(file).iter_messages():
            known.add(channel.topic)
            if channel.topic in wanted:
                yield channel.topic, message.log_time, json.loads(message.data)


def _ros_messages(path: Path, wanted: Collection[str], known: set[str]) -> Iterator[Message]:
    from rosbags.highlevel import AnyReader, AnyReaderError  # noqa: PLC0415  (an extra)
    from rosbags.typesys import Stores, get_typestore  # noqa: PLC0415

    try:
        # bags from before ROS 2 Iron do not hold the definitions of their messages
        store = get_typestore(Stores.ROS2_HUMBLE)
        with AnyReader([path], default_typestore=store) as reader:
            known |= {each.topic for each in reader.connections}
            connections = [each for each in reader.connections if each.topic in wanted]
            if not connections:  # which `messages` takes for all
                return
            for connection, time, content in reader.messages(connections=connections):
                yield connection.topic, time, reader.deserialize(content, connection.msgtype)
    except AnyReaderError as error:
        raise ConversionError(f"{path} cannot be read as a bag: {error}") from error


def _table(name: str, rows: list[tuple[int, Any]]) -> LogTable:
    """The columns of a topic's messages; of arrays those whose length is always the same."""
    columns: dict[str, list[Any]] = {}
    frames = set()
    for _, message in rows:
        for key, value in _leaves(message, ""):
            if isinstance(value, str):
                if key in ("header.frame_id", "frame_id"):
                    frames.add(value)
            else:
                columns.setdefault(key, []).append(value)
    if len(frames) > 1:
        raise ConversionError(
            f"{name} has messages in several frames: {', '.join(sorted(frames))}, expected one"
        )
    cells = {
        key: np.array(values)
        for key, values in columns.items()
        if len(values) == len(rows) and len({np.shape(value) for value in values}) == 1
    }
    log_times = np.array([time for time, _ in rows], np.int64)
    cells |= {**_short_names(cells), "log_time": log_times, "time": _times(cells, log_times)}
    return LogTable(name, cells, _TIME_UNITS, frames.pop() if frames else "")


def _leaves(value: Any, path: str) -> Iterator[tuple[str, Any]]:
    """Every number, array of numbers and text in a message, with its path."""
    if isinstance(value, Mapping):
        inner: Iterable[tuple[str, Any]] = value.items()
    elif is_dataclass(value):
        names = value.__dataclass_fields__
        inner = ((name, getattr(value, name)) for name in names if not name.startswith("__"))
    else:
        array = np.asarray(value) if isinstance(value, list) else value
        if isinstance(value, bool | int | float | str | np.number) or (
            isinstance(array, np.ndarray) and array.ndim == 1 and array.dtype.kind in "biuf"
        ):
            yield path, array
        return
    for name, each in inner:
        yield from _leaves(each, f"{path}.{name}" if path else name)


def _times(cells: Mapping[str, NDArray[Any]], log_times: NDArray[np.int64]) -> NDArray[np.int64]:
    """The stamps of messages, or where they have none the times of writing, [n] ns."""
    for seconds, rest in (
        ("header.stamp.sec", "header.stamp.nanosec"),
        ("timestamp.sec", "timestamp.nsec"),
    ):
        if seconds in cells and rest in cells:
            stamps = cells[seconds].astype(np.int64) * 1_000_000_000 + cells[rest]
            return np.where(stamps == 0, log_times, stamps)
    return log_times


def _short_names(cells: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Columns of poses, points and twists by the names that maps take by default."""
    found = {}
    for prefix in ("pose.pose.", "pose.", ""):
        place, turn = f"{prefix}position.", f"{prefix}orientation."
        if f"{place}x" in cells and f"{turn}w" in cells:
            found = {"x": cells[f"{place}x"], "y": cells[f"{place}y"]}
            found["heading"] = yaw_of(*(cells[f"{turn}{axis}"] for axis in "xyzw"))
            break
    if "point.x" in cells:
        found |= {"x": cells["point.x"], "y": cells["point.y"]}
    if "theta" in cells:
        found["heading"] = cells["theta"]
    for prefix in ("twist.twist.", "twist.", ""):
        if f"{prefix}linear.x" in cells and f"{prefix}angular.z" in cells:
            names = {"v": "linear.x", "vy": "linear.y", "omega": "angular.z"}
            found |= {short: cells[prefix + path] for short, path in names.items()}
            break
    return found


def _transforms(messages: Iterable[Any]) -> Iterator[StaticTransform]:
    """The static transforms of messages of the type tf2_msgs/TFMessage.

    Those that are tilted out of the plane are left out; poses in such a frame are refused.
    """
    for message in messages:
        for each in message.transforms:
            place, turn = each.transform.translation, each.transform.rotation
            if max(abs(turn.x), abs(turn.y)) > MOST_TILT:
                continue
            yield StaticTransform(
                frame=each.child_frame_id,
                parent=each.header.frame_id,
                x=place.x,
                y=place.y,
                heading=2.0 * np.arctan2(turn.z, turn.w),
            )
