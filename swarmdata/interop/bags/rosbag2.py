"""A rosbag2 folder, as `ros2 bag record` makes: metadata.yaml and a compressed MCAP file.

`bag_messages` lists its topics. The custom data of metadata.yaml have the dataset's id and digest;
`swarmdata.json`, with the spec, policies and the table of episodes, and `recipe.yaml` lie in the
folder. Such a bag can be read again by `swarmdata import`, with a map. Write only.
"""

from pathlib import Path

from swarmdata.datasets.dataset import Dataset
from swarmdata.interop.bags.bag_messages import messages_of, open_types, serialized
from swarmdata.interop.bags.mcap_file import KEPT_NAMES, RECIPE_FILE
from swarmdata.interop.conversion.export_note import write_note
from swarmdata.interop.formats import Format

METADATA_VERSION = 9  # of metadata.yaml: the newest that `rosbags` writes


def write(dataset: Dataset, path: Path, frame: str) -> None:
    """Writes a view as one bag."""
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


FORMAT = Format("rosbag2", "ROS 2 bag", KEPT_NAMES, {}, None, write)
