"""An MCAP file of ROS 2 messages in compressed chunks, for Foxglove, `ros2 bag` and the like.

`bag_messages` lists its topics. The metadata record `swarmdata` has the dataset's id and digest;
the attachments are `swarmdata.json`, with the spec, policies and the table of episodes, and
`recipe.yaml`. Such a file can be read again by `swarmdata import`, with a map. Write only.
"""

from pathlib import Path

from swarmdata.datasets.dataset import Dataset
from swarmdata.interop.bags.bag_messages import messages_of, open_types, serialized
from swarmdata.interop.conversion.dataset_facts import NOTED_FACTS, TIME_ARRAYS
from swarmdata.interop.conversion.export_note import NOTE_FILE, note_of
from swarmdata.interop.formats import Format

RECIPE_FILE = "recipe.yaml"

KEPT_NAMES = {
    **{name: f"/team/{name}" for name in TIME_ARRAYS},
    "layout": "/team/layout",
    **dict.fromkeys(NOTED_FACTS, NOTE_FILE),
}


def write(dataset: Dataset, path: Path, frame: str) -> None:
    """Writes a view as one MCAP file."""
    types = open_types(frame)
    from mcap.writer import Writer  # noqa: PLC0415  (an extra)

    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2", library="swarmdata")
        for name, kind, text in (
            (NOTE_FILE, "application/json", note_of(dataset, frame).to_json()),
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


FORMAT = Format("mcap", "MCAP (ROS 2 messages)", KEPT_NAMES, {}, None, write)
