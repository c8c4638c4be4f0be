"""Communication models from short names, inline text, plain data or files."""

import re
from collections.abc import Callable, Mapping
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import Any

from swarmdata.errors import SpecError, UnknownNameError
from swarmdata.specs.frozen import is_file, is_inline, read_tagged
from swarmdata.specs.sensing_models import (
    AnyCommunicationModel,
    Broadcast,
    NoCommunication,
    modified,
)

MEAN_BURST = 4  # steps that a burst of `bursty-<percent>` lasts on average

Kind = type[NoCommunication] | type[Broadcast]
COMMUNICATION_KINDS: dict[str, Kind] = {"none": NoCommunication, "broadcast": Broadcast}
_ALONE: dict[str, AnyCommunicationModel] = {
    "none": NoCommunication.defaults(),
    "perfect": Broadcast.defaults(),
}
_PART = re.compile(r"([a-z]+)(?:-(.*))?")


def communication_model(
    source: str | Path | Mapping[str, Any] | AnyCommunicationModel,
    own: AnyCommunicationModel = _ALONE["perfect"],
) -> AnyCommunicationModel:
    """Returns the communication model that `source` describes.

    Args:
        source: a model; its fields as a mapping, as YAML or JSON text, or in a `.yaml` or `.json`
            file; or a name. `none` and `perfect` (everybody hears every pose at once) stand alone;
            other names are joined by "+", such as `goal+lossy-30+delayed-2+range-1.5`, each
            changing one thing of `own`, or of `perfect` if "=" stands before the first:

            - payload: `pose`, `goal` (pose and goal), `errand` (pose, and the goal of the next
              robot, which alone reads it), `state`, `learned-4` (4 values);
            - links: `nearest-2`, `ring`, `star`; `range-1.5` (m);
            - losses: `lossy-30` (percent, independent), `bursty-30` (percent in the long run, in
              bursts of 4 steps on average), `aloha-8` (collisions in 8 time slots);
            - limits: `bandwidth-1` (messages per step), `bits-8` (of each value), `delayed-2`
              (steps), `expires-5` (steps after which a message is forgotten).

            `lossy` and `delayed` add to the losses and the delay of `own`.
        own: model of the task, which names modify; of a task without messages, they modify
            `perfect`.

    Raises:
        UnknownNameError: a name is unknown, with the nearest known one.
        SpecError: a value is out of range, or two names contradict each other.
    """
    if isinstance(source, NoCommunication | Broadcast):
        return source
    if isinstance(source, str) and not (is_file(source) or is_inline(source)):
        return _from_names(source.strip(), own)
    return read_tagged(source, COMMUNICATION_KINDS, "communication model")


def _from_names(text: str, own: AnyCommunicationModel) -> AnyCommunicationModel:
    names = text.removeprefix("=")
    if names in _ALONE:
        return _ALONE[names]
    fields: dict[str, Any] = {}
    origin: dict[str, str] = {}
    for part in names.split("+"):
        for name, value in _fields_of(part.strip(), text).items():
            if name in fields:
                raise SpecError(
                    f"communication model {text!r}: {origin[name]!r} and {part!r} both set {name}. "
                    "Keep one of them."
                )
            fields[name], origin[name] = value, part
    where = f"communication model {text!r}"
    named = Broadcast.parse(fields, where)
    is_replaced = names != text or not isinstance(own, Broadcast)
    return named if is_replaced else modified(own, named, where)


def _fields_of(part: str, text: str) -> dict[str, Any]:
    match = _PART.fullmatch(part)
    word, value = match.groups() if match else (part, None)
    if word in _ALONE:
        raise SpecError(
            f"communication model {text!r}: {word!r} stands alone. Leave it out, or use it only."
        )
    if word in _PLAIN:
        if value is not None:
            raise SpecError(
                f"communication model {text!r}: {word!r} takes no value, got {part!r}. "
                f"Write {word!r}."
            )
        return _PLAIN[word]
    if word not in _VALUED:
        examples = [f"{word}-{example}" for word, (_, example) in _VALUED.items()]
        raise UnknownNameError("communication model", part, [*_ALONE, *_PLAIN, *examples])
    build, example = _VALUED[word]
    try:
        return build(value or "")
    except (ValueError, InvalidOperation) as error:
        problem = str(error) if isinstance(error, ValueError) else "is not a number"
        got = repr(value) if value else "nothing"
        raise SpecError(
            f"communication model {text!r}: the value of {part!r} {problem}, got {got}. "
            f"Expected something like {word}-{example}."
        ) from error


def _whole(value: str) -> int:
    if not value.isdecimal():
        raise ValueError("is not a whole number")
    return int(value)


def _share(percent: str) -> Decimal:
    """A fraction from a percentage, exact before one rounding: 30 gives 0.3."""
    share = Decimal(percent) / 100
    if not 0 <= share <= 1:
        raise ValueError("is not a percentage between 0 and 100")
    return share


def _bursty(percent: str) -> dict[str, Any]:
    """Bursts of `MEAN_BURST` steps: links are bad for the share enter / (enter + leave) of time."""
    share, leave = _share(percent), 1 / Decimal(MEAN_BURST)
    most = 1 / (1 + leave)
    if share > most:
        raise ValueError(
            f"is more than the {100 * most} percent that bursts of {MEAN_BURST} steps can lose"
        )
    if not share:
        return {}
    return {"bursts": {"enter": float(leave * share / (1 - share)), "leave": float(leave)}}


_PLAIN: dict[str, dict[str, Any]] = {
    "pose": {"payload": "pose"},
    "goal": {"payload": "pose_and_goal"},
    "errand": {"payload": "errand"},
    "state": {"payload": "state"},
    "ring": {"topology": "ring"},
    "star": {"topology": "star"},
}
_VALUED: dict[str, tuple[Callable[[str], dict[str, Any]], str]] = {
    "learned": (lambda value: {"payload": "learned", "message_size": _whole(value)}, "4"),
    "nearest": (lambda value: {"topology": "nearest", "n_nearest": _whole(value)}, "2"),
    "range": (lambda value: {"range": float(Decimal(value))}, "1.5"),
    "lossy": (lambda value: {"drop_probability": float(_share(value))}, "30"),
    "bursty": (_bursty, "30"),
    "aloha": (lambda value: {"slots_in_step": _whole(value)}, "8"),
    "bandwidth": (lambda value: {"messages_per_step": _whole(value)}, "1"),
    "bits": (lambda value: {"bits": _whole(value)}, "8"),
    "delayed": (lambda value: {"delay": _whole(value)}, "2"),
    "expires": (lambda value: {"max_age": _whole(value)}, "5"),
}
