"""Topics of bags as tables: ROS 2 (SQLite, MCAP), ROS 1, and JSON in MCAP.

No ROS is needed. A message becomes a row, and every number in it a column, named by its path, such
as `twist.linear.x`. What maps need most often has short names too: `x`, `y` and `heading` of a
pose or point, `v`, `vy` and `omega` of a twist, and `time`, the stamp of the header, or else the
time at which the message was written (`log_time`).
"""

import json
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, is_dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmdata.errors import ConversionError, quoted
from swarmdata.interop.conversion.foreign_file import ForeignFile
from swarmdata.interop.logs.bag_files import METADATA, RawMessage, raw_messages
from swarmdata.interop.logs.log_tables import MOST_NANOSECONDS, Cells, LogTable, stacked
from swarmdata.interop.logs.planar_frames import plain_frame, yaw_of
from swarmdata.runtime.extras import require_extra
from swarmdata.specs.origins.log_map import StaticTransform

BAG_SUFFIXES = (".bag", ".mcap", ".db3")

STATIC_TOPIC = "/tf_static"

STATIC_TYPES = ("tf2_msgs/msg/TFMessage", "tf2_msgs/TFMessage")

MOST_TILT = 1e-3
"""Greatest share of x and y in a static transform's quaternion: frames turn in the plane only."""

MOST_DEPTH = 32  # of mappings inside each other in a message of JSON

_TIME_UNITS = {"time": "ns", "log_time": "ns"}


@dataclass(frozen=True, slots=True, eq=False)
class BagContents:
    """What was read of a bag: tables by topic, static transforms, and the topics left out."""

    tables: Mapping[str, LogTable]
    transforms: tuple[StaticTransform, ...]
    unread: tuple[str, ...]


def is_bag(path: Path) -> bool:
    """Whether this is a bag: a file by its ending, or a folder with the metadata of one."""
    return (path / METADATA).is_file() if path.is_dir() else path.suffix in BAG_SUFFIXES


def read_bag(path: Path, topics: Collection[str]) -> BagContents:
    """Reads some topics of a bag, and its static transforms.

    Raises:
        ConversionError: it is no bag, is damaged, or has messages of an unknown encoding or type.
        FileKindError: a file of it is no regular file.
        MissingExtraError: the libraries are not installed.
    """
    for package in ("rosbags", "mcap"):
        require_extra(package, "logs", "reading bags")
    known: set[str] = set()
    columns: dict[str, _Columns] = {}
    static: list[Any] = []
    for message in raw_messages(path, {*topics, STATIC_TOPIC}, known):
        topic, time = message.channel.topic, message.time
        if topic == STATIC_TOPIC and topic not in topics:
            if message.channel.kind in STATIC_TYPES and message.channel.encoding != "json":
                static.append(decoded(message))
            continue
        if not isinstance(time, int) or not 0 <= time <= MOST_NANOSECONDS:
            raise message.source.broken(f"its time, {time!r:.40} ns, is out of bounds")
        leaves = _leaves(message.source, decoded(message), "", MOST_DEPTH)
        columns.setdefault(topic, _Columns()).add(time, leaves)
    tables = {
        topic: each.table(f"{topic} of {path.name}") for topic, each in sorted(columns.items())
    }
    transforms = tuple(_transforms(path, static))
    read = {*tables, *([STATIC_TOPIC] if static else [])}
    return BagContents(tables, transforms, tuple(sorted(map(quoted, known - read))))


@dataclass(slots=True)
class _Columns:
    """The numbers of a topic's messages, by their paths."""

    times: list[int] = field(default_factory=list)  # of writing, ns
    values: dict[str, list[Any]] = field(default_factory=dict)  # None where a message lacks it
    frames: set[str] = field(default_factory=set)

    def add(self, time: int, leaves: Iterable[tuple[str, Any]]) -> None:
        """Takes the leaves of a message."""
        row = len(self.times)
        self.times.append(time)
        for key, value in leaves:
            if isinstance(value, str):
                if key in ("header.frame_id", "frame_id"):
                    self.frames.add(plain_frame(value))
                continue
            column = self.values.setdefault(key, [])
            column += [None] * (row - len(column))
            column.append(value)

    def table(self, name: str) -> LogTable:
        """The messages as a table, in the order of their times of writing."""
        if len(self.frames) > 1:
            raise ConversionError(
                f"{name} has messages in several frames: {', '.join(sorted(self.frames))}, "
                "expected one"
            )
        order = np.argsort(np.array(self.times, np.int64), kind="stable").tolist()
        cells: dict[str, Cells] = {}
        for key, values in self.values.items():
            padded = values + [None] * (len(order) - len(values))
            cells[key] = _column([padded[k] for k in order])
        log_times = np.array([self.times[k] for k in order], np.int64)
        numbers = {
            key: each
            for key, each in cells.items()
            if isinstance(each, np.ndarray) and each.dtype != object
        }
        cells |= {**_short_names(numbers), "log_time": log_times}
        cells["time"] = _times(name, numbers, log_times)
        return LogTable(name, cells, _TIME_UNITS, self.frames.pop() if self.frames else "")


def _column(values: list[Any]) -> Cells:
    """Numbers, [n], with NaN where a message has none, or arrays."""
    given = [value for value in values if value is not None]
    if any(isinstance(value, np.ndarray) for value in given):
        if not all(isinstance(value, np.ndarray) for value in given):
            return [str(value) for value in values]  # which are no numbers
        return stacked([np.zeros(0) if value is None else value for value in values])
    if len({isinstance(value, bool) for value in given}) > 1:
        return [str(value) for value in values]
    return np.array([np.nan if value is None else value for value in values])


def _leaves(source: ForeignFile, value: Any, path: str, depth: int) -> Iterator[tuple[str, Any]]:
    """Every number, array of numbers, text and null in a message, with its path."""
    if isinstance(value, Mapping):
        inner: Iterable[tuple[str, Any]] = value.items()
    elif is_dataclass(value):
        names = value.__dataclass_fields__
        inner = ((name, getattr(value, name)) for name in names if not name.startswith("__"))
    else:
        if isinstance(value, list) and all(type(each) in (int, float) for each in value):
            value = np.array(value, np.float64)
        is_row = isinstance(value, np.ndarray) and value.ndim == 1 and value.dtype.kind in "biuf"
        if value is None or is_row or isinstance(value, bool | int | float | str | np.number):
            yield path, value
        return
    if not depth:
        raise source.broken(f"it has more than {MOST_DEPTH} mappings inside each other")
    for name, each in inner:
        yield from _leaves(source, each, f"{path}.{name}" if path else name, depth - 1)


def _times(
    name: str, cells: Mapping[str, NDArray[Any]], log_times: NDArray[np.int64]
) -> NDArray[np.int64]:
    """The stamps of messages, or where they have none the times of writing, [n] ns."""
    for seconds, rest in (
        ("header.stamp.sec", "header.stamp.nanosec"),
        ("timestamp.sec", "timestamp.nsec"),
    ):
        if seconds in cells and rest in cells:
            whole, part = cells[seconds], cells[rest]
            if whole.dtype.kind not in "iu" or part.dtype.kind not in "iu":
                raise ConversionError(f"{name}: {seconds} and {rest} are not always whole numbers")
            if max(np.abs(whole).max(), np.abs(part).max()) > MOST_NANOSECONDS // 10**9:
                raise ConversionError(f"{name}: {seconds} or {rest} is out of bounds")
            stamps = whole.astype(np.int64) * 1_000_000_000 + part.astype(np.int64)
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


def _transforms(path: Path, messages: Iterable[Any]) -> Iterator[StaticTransform]:
    """The static transforms of TFMessages, without those that are tilted out of the plane."""
    for message in messages:
        for each in message.transforms:
            place, turn = each.transform.translation, each.transform.rotation
            norm = np.linalg.norm([turn.x, turn.y, turn.z, turn.w])
            if not max(abs(turn.x), abs(turn.y)) <= MOST_TILT * norm or not norm:
                continue
            heading = yaw_of(*(np.array([getattr(turn, axis)]) for axis in "xyzw"))
            content = {
                "frame": each.child_frame_id,
                "parent": each.header.frame_id,
                "x": place.x,
                "y": place.y,
                "heading": float(heading[0]),
            }
            yield StaticTransform.parse(content, f"a static transform of {path}")


MOST_DIGITS = 18
"""Digits of a whole number in JSON that is exact; a longer one becomes the nearest float."""

_IDL_RULE = "=" * 80 + "\n"
"""Between the definitions of several types in IDL; each follows a line `IDL: <name>`."""


def decoded(message: RawMessage) -> Any:
    """The content of a message: an instance of its class, or mappings, lists and values of JSON."""
    channel, source = message.channel, message.source
    if channel.encoding not in ("json", "cdr", "ros1"):
        raise ConversionError(
            f"{source.path}: the messages of {channel.topic} are in the encoding "
            f"{channel.encoding!r}, expected cdr, ros1 or json"
        )
    if channel.encoding == "json":
        with source.call():
            return json.loads(
                message.content,
                parse_int=lambda text: int(text) if len(text) <= MOST_DIGITS else float(text),
            )
    kind = channel.kind
    if kind.count("/") == 1:  # as ROS 1 writes it
        kind = kind.replace("/", "/msg/")
    is_ros1 = channel.encoding == "ros1"
    with source.call():
        store, digest = _store(kind, channel.definition, channel.language, is_ros1)
    if kind not in store.fielddefs:
        raise ConversionError(
            f"{source.path}: neither the bag nor ROS 2 Humble defines the type {kind!r} of the "
            f"messages of {channel.topic}"
        )
    if digest and channel.digest and digest != channel.digest:
        raise source.broken(f"its type {kind} has the digest {digest}, expected {channel.digest}")
    with source.call():
        if is_ros1:
            return store.deserialize_ros1(message.content, kind)
        return store.deserialize_cdr(message.content, kind)


@lru_cache(maxsize=256)  # compiling the code of a type takes a tenth of a second
def _store(kind: str, definition: str, language: str, is_ros1: bool) -> tuple[Any, str]:
    """The types of a definition, and the digest of one of them; empty without a definition."""
    from rosbags.typesys import (  # noqa: PLC0415  (an extra)
        Stores,
        get_types_from_idl,
        get_types_from_msg,
        get_typestore,
    )

    if not definition:  # as in bags from before ROS 2 Iron
        return get_typestore(Stores.ROS2_HUMBLE), ""
    store = get_typestore(Stores.EMPTY)
    if language == "msg":
        store.register(get_types_from_msg(definition, kind))
    else:
        parts = definition.split(_IDL_RULE)
        texts = [part.partition("\n")[2] for part in parts if part.startswith("IDL: ")]
        types: dict[str, Any] = {}
        for text in texts or parts:
            types.update(get_types_from_idl(text))
        store.register(types)
    if kind not in store.fielddefs:
        return store, ""
    return store, store.generate_msgdef(kind)[1] if is_ros1 else store.hash_rihs01(kind)
