"""Messages of bags as bytes: MCAP, SQLite files and rosbag2 folders of ROS 2, and bags of ROS 1.

Every checksum of a format is checked, and only topics that are asked for leave this module.
"""

import os
import sqlite3
import tempfile
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path, PurePath
from typing import Any, Literal, NamedTuple
from urllib.parse import quote

from swarmdata.interop.conversion.foreign_file import ForeignFile
from swarmdata.runtime.documents import read_document
from swarmdata.runtime.regular_files import check_regular

METADATA = "metadata.yaml"

_BLOCK = 1 << 20  # bytes

_HINTS = {
    ".mcap": "`mcap recover FILE -o NEW` keeps the messages that are whole.",
    ".db3": "`sqlite3 FILE .recover | sqlite3 NEW` keeps the messages that are whole.",
    ".bag": "`rosbag reindex FILE` keeps the messages that are whole.",
}
"""What to do about a damaged file, by its suffix."""


@dataclass(frozen=True, slots=True)
class Channel:
    """What a bag says of the messages of a topic."""

    topic: str  # its name
    kind: str  # type of its messages, such as `nav_msgs/msg/Odometry`
    encoding: str  # of the messages: `cdr`, `ros1`, `json`, or one that we do not read
    definition: str = ""  # of the type, as text; empty if the bag has none
    language: Literal["msg", "idl"] = "msg"  # of the definition
    digest: str = ""
    """Of the type and all that it holds, as ROS computes it; empty if the bag has none."""


class RawMessage(NamedTuple):
    """A message that nobody has decoded yet."""

    source: ForeignFile  # that holds it
    channel: Channel
    time: Any  # of writing, ns, as the file says
    content: bytes


def raw_messages(path: Path, topics: Collection[str], known: set[str]) -> Iterator[RawMessage]:
    """Yields the messages of some topics as they were stored; `known` gets the names of all."""
    if not path.is_dir():
        yield from _of_file(path, ForeignFile(path, _HINTS.get(path.suffix, "")), topics, known)
        return
    names, mode = _listed_in(path)
    for name in names:
        hint = next((hint for suffix, hint in _HINTS.items() if suffix in name), "")
        source = ForeignFile(path / name, hint)
        with tempfile.TemporaryDirectory() as scratch:
            file = _unpacked_copy(source, Path(scratch)) if mode == "file" else source.path
            packing = "zstd" if mode == "message" else ""
            for message in _of_file(file, source, topics, known):
                yield message._replace(content=_unpacked(source, packing, message.content))


def _listed_in(folder: Path) -> tuple[list[str], str]:
    """Names of the files of a rosbag2 folder, and what is compressed: none, file or message."""
    about = ForeignFile(folder / METADATA, "`ros2 bag reindex FOLDER` writes it anew.")
    content = read_document(about.path)
    facts = content.get("rosbag2_bagfile_information") if isinstance(content, dict) else None
    paths = facts.get("relative_file_paths") if isinstance(facts, dict) else None
    if not isinstance(facts, dict) or not isinstance(paths, list) or not paths:
        raise about.broken("it has no rosbag2_bagfile_information.relative_file_paths")
    names = [PurePath(str(path)).name for path in paths]
    mode = str(facts.get("compression_mode") or "none").lower()
    packing = str(facts.get("compression_format") or "").lower()
    if mode not in ("none", "file", "message") or (mode != "none" and packing != "zstd"):
        raise about.broken(f"its compression is {packing!r} of each {mode!r}, expected zstd")
    for name in names:
        if not (folder / name).exists():
            raise about.broken(f"it lists {name!r}, which is not in the folder")
    return names, mode


_Entry = tuple[Channel | str | int, Any, bytes]
"""Channel of a message, or the number of one that the file does not describe, time and content."""


def _of_file(
    file: Path, source: ForeignFile, topics: Collection[str], known: set[str]
) -> Iterator[RawMessage]:
    check_regular(file)
    readers: dict[str, Callable[..., Iterator[_Entry]]] = {
        ".mcap": _of_mcap,
        ".db3": _of_sqlite,
        ".bag": _of_ros1,
    }
    if file.suffix not in readers:
        raise source.broken(f"expected a bag that ends in {', '.join(readers)}")
    entries = readers[file.suffix](file, source, topics, known)
    for n_messages, (channel, time, content) in enumerate(entries, 1):
        source.place = f"message {n_messages:,}"
        if not isinstance(channel, Channel):
            raise source.broken(f"its topic {channel!r} is not in the file")
        if channel.topic in topics:
            source.place += f" ({channel.topic})"
            yield RawMessage(source, channel, time, content)
        source.place = f"after {n_messages:,} messages"


def _unpacked_copy(source: ForeignFile, folder: Path) -> Path:
    """A copy without the compression of the whole file."""
    check_regular(source.path)
    copy = folder / source.path.stem
    with source.path.open("rb") as packed, copy.open("wb") as file:
        file.writelines(_blocks(source, "zstd", packed))
    return copy


def _unpacked(source: ForeignFile, packing: str, content: bytes) -> bytes:
    return content if packing == "" else b"".join(_blocks(source, packing, content))


def _blocks(source: ForeignFile, packing: str, packed: Any) -> Iterator[bytes]:
    """Decompressed bytes, of which no more are ever held than the file may unfold to."""
    import lz4.frame  # noqa: PLC0415  (both come with mcap)
    import zstandard  # noqa: PLC0415

    if packing == "zstd":
        with source.call():
            stream = zstandard.ZstdDecompressor().stream_reader(packed, read_across_frames=True)
        blocks = iter(lambda: stream.read(_BLOCK), b"")
    elif packing == "lz4":
        blocks = _lz4_blocks(lz4.frame.LZ4FrameDecompressor(), packed)
    else:
        raise source.broken(f"its compression is {packing!r}, expected zstd, lz4 or none")
    for block in source.each(blocks):
        source.take(len(block))
        yield block


def _lz4_blocks(unpacker: Any, content: bytes) -> Iterator[bytes]:
    while not unpacker.eof:
        block, content = unpacker.decompress(content, _BLOCK), b""
        if not block and not unpacker.eof:
            raise EOFError("compressed data end too early")
        yield block


def _of_mcap(
    file: Path, source: ForeignFile, topics: Collection[str], known: set[str]
) -> Iterator[_Entry]:
    """Reads the file from its beginning to its end, which its checksums need."""
    from mcap.records import Channel as McapChannel  # noqa: PLC0415  (an extra)
    from mcap.records import Message, Schema  # noqa: PLC0415

    schemas: dict[int, Any] = {}
    channels: dict[int, Channel] = {}
    for record in _mcap_records(file, source):
        if isinstance(record, Schema):
            schemas[record.id] = record
        elif isinstance(record, McapChannel):
            channels[record.id] = _mcap_channel(record, schemas.get(record.schema_id))
            known.add(record.topic)
        elif isinstance(record, Message):
            channel = channels.get(record.channel_id, record.channel_id)
            yield channel, record.log_time, record.data


def _mcap_records(file: Path, source: ForeignFile) -> Iterator[Any]:
    """All records of an MCAP file, those in its chunks included."""
    from mcap.records import Chunk  # noqa: PLC0415  (an extra)
    from mcap.stream_reader import StreamReader, breakup_chunk  # noqa: PLC0415

    with file.open("rb") as stream:
        size = file.stat().st_size
        reader = StreamReader(stream, emit_chunks=True, validate_crcs=True, record_size_limit=size)
        for record in source.each(reader.records):
            if not isinstance(record, Chunk):
                yield record
                continue
            data = _unpacked(source, record.compression, record.data)
            if len(data) != record.uncompressed_size:
                raise source.broken(
                    f"a chunk has {len(data):,} bytes, expected {record.uncompressed_size:,}"
                )
            with source.call():
                inner = breakup_chunk(replace(record, compression="", data=data), validate_crc=True)
            yield from inner


def _mcap_channel(channel: Any, schema: Any) -> Channel:
    if schema is None:
        return Channel(channel.topic, "", channel.message_encoding)
    is_ros = schema.encoding in ("ros1msg", "ros2msg", "ros2idl", "omgidl")
    return Channel(
        topic=channel.topic,
        kind=schema.name,
        encoding=channel.message_encoding,
        definition=schema.data.decode(errors="replace") if is_ros else "",
        language="idl" if schema.encoding.endswith("idl") else "msg",
    )


def _of_sqlite(
    file: Path, source: ForeignFile, topics: Collection[str], known: set[str]
) -> Iterator[_Entry]:
    for suffix in ("-wal", "-journal"):
        rest = Path(f"{file}{suffix}")
        if rest.exists() and rest.stat().st_size:
            raise source.broken(
                f"{rest.name} holds what was never merged into it, since the recording was cut "
                "off; `sqlite3 FILE 'PRAGMA wal_checkpoint'` does that"
            )
    address = f"file:{quote(os.fsencode(file))}?mode=ro&immutable=1"
    with source.call():
        opened = sqlite3.connect(address, uri=True)
    with closing(opened) as database:
        with source.call():
            (state,) = database.execute("PRAGMA quick_check(1)").fetchone()
            if state != "ok":
                raise sqlite3.DatabaseError(state)
            channels = _sqlite_channels(database)
            rows = database.execute(
                "SELECT CAST(topic_id AS TEXT), timestamp, data FROM messages "
                "ORDER BY timestamp, id"
            )
        known |= {channel.topic for channel in channels.values()}
        for number, time, content in source.each(rows):
            yield channels.get(number, number), time, content


def _sqlite_channels(database: sqlite3.Connection) -> Mapping[str, Channel]:
    """The channels of a database of rosbag2, by their numbers."""

    def rows(table: str, *columns: str) -> list[tuple[str, ...]]:
        found = {row[1] for row in database.execute(f"PRAGMA table_info({table})")}
        wanted = ", ".join(
            f"CAST(IFNULL({each}, '') AS TEXT)" if each in found else "''" for each in columns
        )
        return database.execute(f"SELECT {wanted} FROM {table}").fetchall() if found else []

    kinds = ("topic_type", "encoding", "encoded_message_definition")
    definitions = {row[0]: row[1:] for row in rows("message_definitions", *kinds)}
    columns = ("id", "name", "type", "serialization_format", "type_description_hash")
    channels = {}
    for number, topic, kind, encoding, digest in rows("topics", *columns):
        name, definition = definitions.get(kind, ("", ""))
        language: Literal["msg", "idl"] = "idl" if name == "ros2idl" else "msg"
        channels[number] = Channel(topic, kind, encoding, definition, language, digest)
    return channels


def _of_ros1(
    file: Path, source: ForeignFile, topics: Collection[str], known: set[str]
) -> Iterator[_Entry]:
    from rosbags.rosbag1 import Reader  # noqa: PLC0415  (an extra)

    reader = Reader(file)
    with source.call():
        reader.open()
    with closing(reader):
        known |= {each.topic for each in reader.connections}
        chosen = [each for each in reader.connections if each.topic in topics]
        if not chosen:  # which `messages` takes for all
            return
        for connection, time, content in source.each(reader.messages(connections=chosen)):
            channel = Channel(
                topic=connection.topic,
                kind=connection.msgtype,
                encoding="ros1",
                definition=connection.msgdef.data,
                digest=connection.digest,
            )
            yield channel, time, content
