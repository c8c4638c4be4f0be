"""Messages of ROS 2 as bytes, by the definitions of a distribution that `rosbags` ships."""

from collections.abc import Mapping
from typing import Any

from swarmdata.interop.bags.bag_messages import Message
from swarmdata.runtime.extras import require_extra


class RosMessages:
    """Serializes messages.

    Raises:
        MissingExtraError: the extra `logs` is not installed.
    """

    def __init__(self) -> None:
        for package in ("rosbags", "mcap"):
            require_extra(package, "logs", "writing bags")
        from rosbags.typesys import Stores, get_typestore  # noqa: PLC0415  (an extra)

        self.store = get_typestore(Stores.ROS2_HUMBLE)

    def definition(self, kind: str) -> str:
        """Text of a message's definition, with those of the messages in it."""
        return str(self.store.generate_msgdef(kind, ros_version=2)[0])

    def serialized(self, message: Message) -> bytes:
        """Bytes of a message in CDR."""
        return bytes(
            self.store.serialize_cdr(self._built(message.kind, message.fields), message.kind)
        )

    def _built(self, kind: str, fields: Mapping[str, Any]) -> Any:
        """An instance of a message's class."""
        _, definitions = self.store.fielddefs[kind]
        values = {name: self._value(field, fields[name]) for name, field in definitions}
        return self.store.types[kind](**values)

    def _value(self, field: Any, value: Any) -> Any:
        """A field's value, in which mappings have become messages."""
        if isinstance(value, Mapping):
            return self._built(field[1], value)
        if isinstance(value, list):
            return [self._value(field[1][0], each) for each in value]
        return value
