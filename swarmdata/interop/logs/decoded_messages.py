"""Decodes messages of bags: of ROS by the types that the bag defines, and of JSON."""

import json
from functools import lru_cache
from typing import Any

from swarmdata.errors import ConversionError
from swarmdata.interop.logs.bag_files import RawMessage

MOST_DIGITS = 18
"""Digits of a whole number in JSON that is exact; a longer one becomes the nearest float."""

_IDL_RULE = "=" * 80 + "\n"
"""Between the definitions of several types in IDL; each follows a line `IDL: <name>`."""


def decoded(message: RawMessage) -> Any:
    """The content of a message: an instance of its class, or mappings, lists and values of JSON.

    Raises:
        ConversionError: the message is damaged, or its encoding or type is not known.
    """
    channel, source = message.channel, message.source
    if channel.encoding not in ("json", "cdr", "ros1"):
        raise ConversionError(
            f"{source.path}: the messages of {channel.topic} are in the encoding "
            f"{channel.encoding!r}, expected cdr, ros1 or json"
        )
    if channel.encoding == "json":
        with source.call():
            return json.loads(message.content, parse_int=_whole)
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


def _whole(text: str) -> int | float:
    return int(text) if len(text) <= MOST_DIGITS else float(text)


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
