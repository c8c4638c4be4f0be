"""Damaged, unfinished and hostile logs: one error with the file and the place, and nothing made."""

import contextlib
import json
import os
import shutil
import sqlite3
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import ConversionError, FileKindError, SwarmdataError
from swarmdata.interop.logs.bag_tables import BagContents, read_bag
from swarmdata.interop.logs.import_logs import import_logs
from swarmdata.specs.origins.log_map import LogMap
from tests.interop.logs import bags
from tests.interop.logs.logged_team import MAP, drive, log_map

pytest.importorskip("rosbags", reason="the extra 'logs'")
pytest.importorskip("mcap", reason="the extra 'logs'")


@pytest.fixture
def few_free_bytes(monkeypatch: pytest.MonkeyPatch) -> int:
    """Bytes that a file may unfold to, however small it is."""
    monkeypatch.setattr("swarmdata.interop.conversion.foreign_file.FREE_BYTES", 1 << 20)
    return 1 << 20


TOPICS = {f"/{name}/{each}" for name in bags.ROBOTS for each in ("odom", "cmd_vel", "scan", "pose")}


def write_mcap(path: Path) -> Path:
    """An MCAP file with the checksums that the tools of ROS 2 write, which `rosbags` does not."""
    from mcap.writer import CompressionType, Writer
    from rosbags.typesys import Stores, get_typestore

    types = get_typestore(Stores.ROS2_HUMBLE)
    with path.open("wb") as file:
        writer = Writer(
            file, chunk_size=4096, compression=CompressionType.NONE, enable_data_crcs=True
        )
        writer.start("ros2", "test")
        channels: dict[str, int] = {}
        for topic, kind, ns, message in bags.team(types, 0.5):
            if topic not in channels:
                text = types.generate_msgdef(kind, ros_version=2)[0].encode()
                schema = writer.register_schema(kind, "ros2msg", text)
                channels[topic] = writer.register_channel(topic, "cdr", schema)
            content = bytes(types.serialize_cdr(message, kind))
            writer.add_message(channels[topic], ns, content, ns)
        writer.finish()
    return path


def write_sqlite(path: Path) -> Path:
    folder = path.with_suffix("")
    (found,) = bags.write_ros2(folder, storage="sqlite3", seconds=0.5).glob("*.db3")
    shutil.copy(found, path)
    return path


WRITERS: dict[str, Callable[[Path], Path]] = {
    "cdr.mcap": write_mcap,
    "json.mcap": lambda path: bags.write_json(path, 0.5),
    "ros.bag": lambda path: bags.write_ros1(path, 0.5),
    "ros.db3": write_sqlite,
}


@pytest.fixture(scope="module", params=WRITERS)
def whole(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A bag of half a second in each kind of file."""
    return WRITERS[request.param](tmp_path_factory.mktemp("whole") / request.param)


def same(found: BagContents, expected: BagContents) -> bool:
    cells, wanted = (
        {(topic, name): c for topic, t in each.tables.items() for name, c in t.cells.items()}
        for each in (found, expected)
    )
    return (
        found.transforms == expected.transforms
        and cells.keys() == wanted.keys()
        and all(np.array_equal(cells[key], wanted[key]) for key in wanted)
    )


def contents_or_error(log: Path) -> BagContents | str:
    try:
        return read_bag(log, TOPICS)
    except SwarmdataError as error:
        return str(error)


def damaged(content: bytes, count: int) -> Iterator[bytes]:
    """The content with one byte flipped, at places all over the file."""
    for place in np.linspace(0, len(content) - 1, count).astype(int):
        changed = bytearray(content)
        changed[place] ^= 0x5A
        yield bytes(changed)


@pytest.mark.slow
def test_a_flipped_byte_is_found_or_harmless(whole: Path, tmp_path: Path) -> None:
    expected = read_bag(whole, TOPICS)
    broken, n_changed, n_refused = tmp_path / whole.name, 0, 0
    for content in damaged(whole.read_bytes(), 80):
        broken.write_bytes(content)
        found = contents_or_error(broken)
        if isinstance(found, BagContents):
            n_changed += not same(found, expected)
        else:
            n_refused += broken.name in found and found.isprintable()
    assert n_refused >= 5
    if whole.suffix == ".mcap":  # whose checksums are those of all values
        assert (n_changed, n_refused > 40) == (0, True)


@pytest.mark.slow
def test_a_file_that_was_cut(whole: Path, tmp_path: Path) -> None:
    content, cut = whole.read_bytes(), tmp_path / whole.name
    for share in (0.0, 0.05, 0.3, 0.6, 0.9):
        cut.write_bytes(content[: int(share * len(content))])
        with pytest.raises(ConversionError, match=f"{cut.name}.* cannot be read.*`"):
            read_bag(cut, TOPICS)


def test_the_message_is_numbered_and_the_tool_named(tmp_path: Path) -> None:
    log = write_mcap(tmp_path / "monday.mcap")
    log.write_bytes(log.read_bytes()[:20_000])
    with pytest.raises(ConversionError, match=r"after \d+ messages: .*`mcap recover FILE -o NEW`"):
        read_bag(log, TOPICS)


GOOD = b'{"x": 1.0}'


@pytest.mark.parametrize(
    "content",
    [b"{", b"\xff", b'{"a":' * 100_000, b'{"a":' * 500 + b"1" + b"}" * 500, b"[" * 200, b"",
     b'{"x": ' + b"9" * 5000 + b"}"],
    ids=["cut", "bytes", "deep", "nested", "lists", "empty", "digits"],
)  # fmt: skip
def test_a_message_that_is_no_json(tmp_path: Path, content: bytes) -> None:
    log = bags.write_messages(tmp_path / "a.mcap", ("/a", "json", GOOD), ("/a", "json", content))
    if content.startswith(b'{"x"'):  # a number beyond all bounds is infinite, and refused later
        assert np.isinf(read_bag(log, {"/a"}).tables["/a"].numbers("x")[1])
        return
    with pytest.raises(ConversionError, match=r"a\.mcap cannot be read: message 2 \(/a\): "):
        read_bag(log, {"/a"})


def test_odd_values_in_json(tmp_path: Path) -> None:
    rows = [
        {"x": 1, "t": True, "r": [1, 2], "n": [[1], [2, 3]], "big": 2**70, "e": []},
        {"x": None, "t": 2.0, "r": [1], "n": [], "big": -(2**70), "m": 7},
    ]
    messages = [("/a", "json", json.dumps(row).encode()) for row in rows]
    table = read_bag(bags.write_messages(tmp_path / "a.mcap", *messages), {"/a"}).tables["/a"]
    np.testing.assert_array_equal(table.numbers("x"), [1, np.nan])
    np.testing.assert_array_equal(table.numbers("m"), [np.nan, 7])
    np.testing.assert_array_equal(table.numbers("big"), [2.0**70, -(2.0**70)])
    assert [len(row) for row in table.arrays("r")] == [2, 1]
    with pytest.raises(ConversionError, match="'r' has rows of 1 to 2 numbers"):
        table.numbers("r")
    with pytest.raises(ConversionError, match="'True', expected a number"):
        table.numbers("t")


@pytest.mark.parametrize("stamp", [{"sec": 10**30, "nsec": 0}, {"sec": 1.5, "nsec": 0}])
def test_stamps_that_are_none(tmp_path: Path, stamp: dict[str, Any]) -> None:
    content = json.dumps({"timestamp": stamp, "x": 1.0}).encode()
    with pytest.raises(ConversionError, match=r"timestamp\.sec"):
        read_bag(bags.write_messages(tmp_path / "a.mcap", ("/a", "json", content)), {"/a"})


def test_only_channels_that_are_asked_for_are_parsed(tmp_path: Path) -> None:
    others = [
        ("/a/_service_event", "cdr", b"\0"),
        ("/video", "protobuf", b""),
        ("/b", "json", b"{"),
    ]
    log = bags.write_messages(tmp_path / "a.mcap", ("/a", "json", GOOD), *others)
    found = read_bag(log, {"/a"})
    assert found.tables["/a"].numbers("x").tolist() == [1.0]
    assert found.unread == ("/a/_service_event", "/b", "/video")
    with pytest.raises(
        ConversionError, match="/video are in the encoding 'protobuf', expected cdr"
    ):
        read_bag(log, {"/video"})
    with pytest.raises(ConversionError, match=r"defines the type 'any' of .* /a/_service_event"):
        read_bag(log, {"/a/_service_event"})


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_a_type_of_an_unread_topic_does_not_matter(tmp_path: Path, storage: str) -> None:
    folder = bags.write_ros2(tmp_path / "monday", storage=storage, seconds=0.5)
    expected = read_bag(folder, {"/robot_0/odom"})
    metadata = folder / "metadata.yaml"
    text = metadata.read_text().replace("serialization_format: cdr", "serialization_format: json")
    metadata.write_text(text)  # as that of a bag with one topic of JSON
    if storage == "sqlite3":
        (log,) = folder.glob("*.db3")
        with sqlite3.connect(log) as database:
            database.execute("UPDATE topics SET type = 'a/b/C' WHERE name LIKE '%/scan'")
            database.execute("UPDATE topics SET offered_qos_profiles = '{' WHERE type = 'a/b/C'")
        database.close()
    assert same(read_bag(folder, {"/robot_0/odom"}), expected)


@pytest.mark.parametrize(
    "others", [["/b\x1b[31m\n"], [f"/a_long_name_of_a_topic_{k}" for k in range(500)]]
)
def test_names_and_number_of_unread_topics_do_not_matter(tmp_path: Path, others: list[str]) -> None:
    rows = [
        {"x": 0.1 * k, "y": 0, "heading": 0, "v": 0.3, "omega": 0.1 * (k % 3)} for k in range(9)
    ]
    messages = [("/a", "json", json.dumps(row).encode()) for row in rows]
    log = bags.write_messages(
        tmp_path / "a.mcap", *messages, *((each, "json", GOOD) for each in others)
    )
    each = {"topic": "/a", "command": {"components": [{"column": "v", "low": 0, "high": 1}]}}
    log_map = LogMap.parse({"dt": 1.0, "max_gap": 2, "each": each, "robots": ["anna"]})
    dataset = import_logs(log, tmp_path / "dataset", log_map=log_map, id="hall-bags-v0")
    noted = (dataset.recipe.metadata or {})["unread_topics"]
    assert noted == r"/b\x1b[31m" or noted.endswith(" more")


def test_flags_are_features_and_no_positions(tmp_path: Path) -> None:
    rows = [{"x": 0.1 * k, "y": True, "heading": 0, "v": 0.3, "hit": k > 4} for k in range(9)]
    messages = [("/a", "json", json.dumps(row).encode()) for row in rows]
    log = bags.write_messages(tmp_path / "a.mcap", *messages)
    command = {"components": [{"column": "v", "low": 0, "high": 1}]}
    each: dict[str, Any] = {"topic": "/a", "command": command, "pose": {"y": "heading"}}
    each["features"] = [{"name": "hit", "column": "hit", "between": "held"}]
    content = {"dt": 1.0, "max_gap": 2, "each": each, "robots": ["anna"]}
    dataset = import_logs(log, tmp_path / "a", log_map=LogMap.parse(content), id="hall-bags-v0")
    np.testing.assert_array_equal(dataset[0].observations[:, 0, 0], [0.0] * 5 + [1.0] * 4)
    del each["pose"]
    with pytest.raises(ConversionError, match="true and false in column 'y', expected a length"):
        import_logs(log, tmp_path / "b", log_map=LogMap.parse(content), id="hall-bags-v0")


def test_frames_with_and_without_a_slash(tmp_path: Path) -> None:
    rows = [json.dumps({"frame_id": frame, "x": 1.0}).encode() for frame in ("/map", "map")]
    log = bags.write_messages(tmp_path / "a.mcap", *(("/a", "json", row) for row in rows))
    assert read_bag(log, {"/a"}).tables["/a"].frame == "map"
    rows.append(b'{"frame_id": "odom", "x": 1.0}')
    log = bags.write_messages(tmp_path / "a.mcap", *(("/a", "json", row) for row in rows))
    with pytest.raises(ConversionError, match="in several frames: map, odom"):
        read_bag(log, {"/a"})


@pytest.mark.parametrize("compression", ["ZSTD", "LZ4"])
def test_a_bag_that_unfolds_without_end(
    tmp_path: Path, compression: str, few_free_bytes: int
) -> None:
    from mcap.writer import CompressionType

    content = b'{"x": "' + b" " * few_free_bytes + b'"}'
    log = bags.write_messages(
        tmp_path / "a.mcap",
        *[("/b", "json", content)] * 5,
        compression=CompressionType[compression],
        chunk_size=1,
    )
    with pytest.raises(ConversionError, match=r"a\.mcap .* unfolds to more than"):
        read_bag(log, {"/a"})


@pytest.mark.parametrize(
    ("part", "words"),
    [
        ("name", "compression is 'zste', expected zstd, lz4 or none"),
        ("size", r"a chunk has \d+ bytes, expected \d+"),
    ],
)
def test_a_chunk_that_lies(tmp_path: Path, part: str, words: str) -> None:
    """Of how it is packed, or of its size, which stands before the checksum and the name."""
    from mcap.writer import CompressionType

    options = {"compression": CompressionType.ZSTD, "enable_crcs": False}
    log = bags.write_messages(tmp_path / "a.mcap", ("/a", "json", GOOD), **options)
    content = bytearray(log.read_bytes())
    name = content.index(b"zstd")
    content[{"name": name + 3, "size": name - 16}[part]] += 1
    log.write_bytes(content)
    with pytest.raises(ConversionError, match=words):
        read_bag(log, {"/a"})


def test_a_database_that_was_cut_off_while_recording(tmp_path: Path) -> None:
    log = write_sqlite(tmp_path / "monday.db3")
    (tmp_path / "monday.db3-wal").write_bytes(b"x")
    with pytest.raises(ConversionError, match=r"monday\.db3-wal holds .*wal_checkpoint"):
        read_bag(log, TOPICS)


@pytest.mark.parametrize(
    ("column", "value", "words"),
    [("topic_id", 99, r"message \d+: its topic '99' is not in the file"),
     *(("timestamp", time, r"message \d+ \(.*\): its time, .* out of bounds")
       for time in (-5, 2**62 + 1, "noon", None))],
)  # fmt: skip
def test_a_database_with_odd_messages(tmp_path: Path, column: str, value: Any, words: str) -> None:
    log = write_sqlite(tmp_path / "monday.db3")
    with sqlite3.connect(log) as database:  # a copy, which has no constraints
        database.execute("CREATE TABLE copy AS SELECT * FROM messages")
        database.execute("DROP TABLE messages")
        database.execute("ALTER TABLE copy RENAME TO messages")
        database.execute(f"UPDATE messages SET {column} = ? WHERE id = 5", (value,))
    database.close()
    with pytest.raises(ConversionError, match=words):
        read_bag(log, TOPICS)


@pytest.mark.parametrize(
    "change",
    [("sqlite3", "cassandra"), ("relative_file_paths", "paths"), ("\n", "\n\t"), (".db3", ".db4"),
     ("compression_mode: ''", "compression_mode: FILE")],
)  # fmt: skip
def test_metadata_that_lie(tmp_path: Path, change: tuple[str, str]) -> None:
    folder = bags.write_ros2(tmp_path / "monday", storage="sqlite3", seconds=0.5)
    metadata = folder / "metadata.yaml"
    assert change[0] in metadata.read_text()
    metadata.write_text(metadata.read_text().replace(*change))
    if change[0] == "sqlite3":  # the files say themselves what they are
        assert len(read_bag(folder, TOPICS).tables) == 12
        return
    with pytest.raises(SwarmdataError, match=r"metadata\.yaml"):
        read_bag(folder, TOPICS)


@pytest.mark.parametrize("mode", ["FILE", "MESSAGE"])
def test_compressed_folders(tmp_path: Path, mode: str) -> None:
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    expected = read_bag(bags.write_ros2(tmp_path / "a", storage="sqlite3", seconds=0.5), TOPICS)
    types = get_typestore(Stores.ROS2_HUMBLE)
    writer = Writer(tmp_path / "b", version=9, storage_plugin=StoragePlugin.SQLITE3)
    writer.set_compression(CompressionMode[mode], CompressionFormat.ZSTD)
    with writer:
        bags.write_team(writer, types, 0.5, types.serialize_cdr)
    found = read_bag(tmp_path / "b", TOPICS)
    assert [table.numbers("time").tolist() for table in found.tables.values()] == [
        table.numbers("time").tolist() for table in expected.tables.values()
    ]
    if mode == "FILE":
        (packed,) = (tmp_path / "b").glob("*.zstd")
        packed.write_bytes(packed.read_bytes()[:-100])
        with pytest.raises(ConversionError, match=packed.name):
            read_bag(tmp_path / "b", TOPICS)


def make(log: Path, out: Path) -> Dataset:
    return import_logs(log, out, log_map=LogMap.parse(bags.MAP), id="hall-bags-v0")


@pytest.mark.parametrize("name", ["anna.csv", "anna.mcap", "anna.bag"])
def test_a_pipe_in_place_of_a_log(tmp_path: Path, name: str) -> None:
    os.mkfifo(tmp_path / name)
    with pytest.raises(FileKindError, match=f"{name} is a pipe, expected a regular file"):
        make(tmp_path / name, tmp_path / "dataset")


def test_a_topic_without_messages(tmp_path: Path) -> None:
    from mcap.writer import Writer

    log = tmp_path / "a.mcap"
    with log.open("wb") as file:
        writer = Writer(file)
        writer.start("", "test")
        writer.register_channel("/robot_0/odom", "json", 0)
        writer.finish()
    with pytest.raises(ConversionError, match="has no messages of /robot_0/odom"):
        make(log, tmp_path / "dataset")


def parquet(folder: Path, **columns: Any) -> Path:
    arrow = pytest.importorskip("pyarrow", reason="the extra 'parquet'")
    parquet = pytest.importorskip("pyarrow.parquet", reason="the extra 'parquet'")
    path = folder / "anna.csv.parquet"
    parquet.write_table(arrow.table(columns), path, write_page_checksum=True)
    return path


def of_parquet(log: Path, out: Path) -> Dataset:
    signals = {key: value for key, value in MAP["each"].items() if key != "log"}
    mapped = log_map(robots=["anna"], each=signals)
    return import_logs(log, out, log_map=mapped, id="hall-bags-v0")


def test_a_flipped_byte_in_parquet(tmp_path: Path) -> None:
    log = parquet(tmp_path, **drive(20.0))
    content = log.read_bytes()
    digest = of_parquet(log, tmp_path / "whole").digest
    n_refused = 0
    for k, broken in enumerate(damaged(content, 40)):
        log.write_bytes(broken)
        out = tmp_path / str(k)
        with contextlib.suppress(ConversionError):
            assert of_parquet(log, out).digest == digest
        n_refused += not out.exists()
    assert n_refused > 30


def test_times_of_parquet(tmp_path: Path) -> None:
    arrow = pytest.importorskip("pyarrow", reason="the extra 'parquet'")
    columns: dict[str, Any] = drive(60.0)
    expected = of_parquet(parquet(tmp_path, **columns), tmp_path / "a")
    micros = np.round(columns["t"] * 1e6).astype(np.int64)
    columns["t"] = arrow.array(micros).cast(arrow.duration("us"))
    assert of_parquet(parquet(tmp_path, **columns), tmp_path / "b").digest == expected.digest
    micros[3] = 253_402_300_000 * 10**6  # the year 9999
    columns["t"] = arrow.array(micros).cast(arrow.timestamp("us"))
    with pytest.raises(ConversionError, match=r"anna.*parquet cannot be read: column 't': "):
        of_parquet(parquet(tmp_path, **columns), tmp_path / "c")


def test_a_small_file_of_very_many_rows(tmp_path: Path, few_free_bytes: int) -> None:
    arrow = pytest.importorskip("pyarrow", reason="the extra 'parquet'")
    n_rows = few_free_bytes
    log = parquet(tmp_path, t=arrow.array(np.zeros(n_rows)), x=arrow.array(np.zeros(n_rows)))
    assert log.stat().st_size < few_free_bytes // 100
    with pytest.raises(ConversionError, match="unfolds to more than"):
        of_parquet(log, tmp_path / "dataset")
