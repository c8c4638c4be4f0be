"""Bags of ROS 2 messages, whose topics `bag_messages` lists: an MCAP file, or a rosbag2 folder.

A file is for Foxglove, `ros2 bag` and the like; a folder is as `ros2 bag record` makes it, with
metadata.yaml. Both have compressed chunks, the dataset's id and digest as their metadata, and
beside the messages `swarmdata.json`, with the spec, policies and the table of episodes, and
`recipe.yaml`: a file as attachments. Either can be read again by `swarmdata import`, with a map.
"""

from pathlib import Path

from swarmdata.datasets.dataset import Dataset
from swarmdata.interop.bags.bag_messages import messages_of, open_types, serialized
from swarmdata.interop.conversion.dataset_facts import NOTED_FACTS, TIME_ARRAYS
from swarmdata.interop.conversion.export_note import NOTE_FILE, note_text, write_note
from swarmdata.interop.formats import Format

RECIPE_FILE = "recipe.yaml"
METADATA_VERSION = 9  # of metadata.yaml: the newest that `rosbags` writes

KEPT_NAMES = {
    **{name: f"/team/{name}" for name in TIME_ARRAYS},
    "layout": "/team/layout",
    **dict.fromkeys(NOTED_FACTS, NOTE_FILE),
}


def write_file(dataset: Dataset, path: Path, frame: str) -> None:
    """Writes a view as one MCAP file."""
    types = open_types(frame)
    from mcap.writer import Writer  # noqa: PLC0415  (an extra)

    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2", library="swarmdata")
        for name, kind, text in (
            (NOTE_FILE, "application/json", note_text(dataset, frame)),
            (RECIPE_FILE, "application/yaml", dataset.recipe.to_yaml()),
        ):
            writer.add_attachment(0, 0, name, kind, text.encode())
        writer.add_metadata("swarmdata", {"id": dataset.id, "digest": dataset.digest})
        schemas: dict[str, int] = {}
        channels: dict[str, int] = {}
        for message in messages_of(dataset):
            topic, kind = message.topic, message.kind
            if kind not in schemas:
                definition, _ = types.generate_msgdef(kind, ros_version=2)
                schemas[kind] = writer.register_schema(kind, "ros2msg", definition.encode())
            if topic not in channels:
                channels[topic] = writer.register_channel(topic, "cdr", schemas[kind])
            data = serialized(types, message)
            writer.add_message(channels[topic], message.time, data, message.time)
        writer.finish()


def write_folder(dataset: Dataset, path: Path, frame: str) -> None:
    """Writes a view as one rosbag2 folder."""
    types = open_types(frame)
    from rosbags.rosbag2 import (  # noqa: PLC0415  (an extra)
        CompressionFormat,
        CompressionMode,
        StoragePlugin,
        Writer,
    )

    writer = Writer(path, version=METADATA_VERSION, storage_plugin=StoragePlugin.MCAP)
    writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    writer.set_custom_data("swarmdata_id", dataset.id)
    writer.set_custom_data("swarmdata_digest", dataset.digest)
    with writer:
        connections = {}
        for message in messages_of(dataset):
            topic = message.topic
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, message.kind, typestore=types)
            writer.write(connections[topic], message.time, serialized(types, message))
    write_note(dataset, path, frame)
    (path / RECIPE_FILE).write_text(dataset.recipe.to_yaml(), encoding="utf-8")


MCAP = Format("mcap", "MCAP (ROS 2 messages)", KEPT_NAMES, {}, None, write_file)
ROSBAG2 = Format("rosbag2", "ROS 2 bag", KEPT_NAMES, {}, None, write_folder)
