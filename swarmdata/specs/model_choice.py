"""Models, simulator and randomization of a spec: chosen, replaced, described."""

import logging
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from swarmdata.errors import PolicyFitError, SpecError, UnknownNameError, check_type
from swarmdata.specs.communication_names import communication_model
from swarmdata.specs.frozen import Frozen
from swarmdata.specs.observation_names import observation_model
from swarmdata.specs.randomization import SENSED_RANGES, Randomization
from swarmdata.specs.sensing_models import Broadcast, NoCommunication, StateModel
from swarmdata.specs.task_spec import BACKENDS, TaskSpec

if TYPE_CHECKING:
    from swarmdata.specs.features import Feature

_LOG = logging.getLogger("swarmdata")

Source = str | Path | Mapping[str, Any] | Frozen
"""A model, its fields, a file or text of them, or a name such as `lidar` or `lossy-30`."""

Ranges = Randomization | Mapping[str, tuple[float, float]]
"""Ranges from which episodes draw, by name; an empty mapping draws nothing."""


def ranges_of(source: Ranges) -> Randomization:
    """Returns the randomization that these ranges are.

    Raises:
        SpecError: there is no such field, or a range is out of its bounds.
    """
    if isinstance(source, Randomization):
        return source
    return Randomization.parse(dict(source), "randomization")


def with_models(
    spec: TaskSpec,
    observation: Source | None = None,
    communication: Source | None = None,
    backend: str | None = None,
    randomization: Ranges | None = None,
    own: TaskSpec | None = None,
) -> TaskSpec:
    """Returns the same task with other models, simulator or ranges; None keeps the spec's.

    Args:
        spec: the task, or what it was made with other models.
        observation: a full model, which replaces that of the spec; or a name such as `noise-0.05`,
            which modifies that of `own`.
        communication: likewise, such as `lossy-30`.
        backend: simulator.
        randomization: ranges from which episodes draw.
        own: the task with its own models, where `spec` has others; None: `spec` itself.

    Raises:
        UnknownNameError: no such model or simulator, with the nearest known name.
        SpecError: a value out of its range, a text or file that is no model, or a model of the
            other kind.
    """
    own = spec if own is None else own
    changes: dict[str, Any] = {}
    if observation is not None:
        changes["observation"] = _model_of("observation", observation, own)
    if communication is not None:
        changes["communication"] = _model_of("communication", communication, own)
    if backend is not None:
        if backend not in BACKENDS:
            raise UnknownNameError("backend", backend, BACKENDS)
        changes["backend"] = backend
    if randomization is not None:
        changes["randomization"] = ranges_of(randomization)
    return spec.with_updates(**changes) if changes else spec


_READERS: dict[str, Callable[..., Frozen]] = {
    "observation": observation_model, "communication": communication_model,
}  # fmt: skip


def _model_of(kind: str, source: Source, own: TaskSpec) -> Frozen:
    """Reads a model of a kind; a name of the other kind is refused as such."""
    given = (str, Path, Mapping, Frozen)
    check_type(f"{kind} model", source, given, "a name, a model, its fields, or a file of them")
    try:
        return _READERS[kind](source, getattr(own, kind))
    except UnknownNameError as error:
        (other,) = _READERS.keys() - {kind}
        if not _is_known(other, source, own):
            raise
        raise SpecError(
            f"{source!r} was given as the {kind} model, but is one for {other}. Pass it as {other} "
            f"(--{other})."
        ) from error


def _is_known(kind: str, source: Source, own: TaskSpec) -> bool:
    """Whether a name means a model of a kind, even if a value in it is out of its range."""
    try:
        _READERS[kind](source, getattr(own, kind))
    except UnknownNameError:
        return False
    except SpecError:
        return True
    return True


def check_messages(spec: TaskSpec, recorded: TaskSpec) -> None:
    """Checks that the recorded actions hold the learned messages of a spec.

    Raises:
        SpecError: none were recorded, or of another size.
    """
    model = spec.communication
    if not isinstance(model, Broadcast) or model.payload != "learned":
        return
    if spec.action_size != recorded.action_size:
        got = recorded.action_size - 2
        found = f"messages of {got} values" if got else "none"
        raise SpecError(
            f"the channel needs learned messages of {model.message_size} values. They are part of "
            f"the recorded actions, which hold {found} ({describe(recorded)}). Choose another "
            "payload, such as pose, or a dataset whose policies learned to communicate."
        )


def is_same_world(first: TaskSpec, second: TaskSpec) -> bool:
    """Whether two specs differ in their models only: states, rewards and returns are the same."""
    return _unsensed(first) == _unsensed(second)


def _unsensed(spec: TaskSpec) -> TaskSpec:
    drawn = spec.randomization.ranges
    ranges = {name: span for name, span in drawn.items() if name not in SENSED_RANGES}
    return with_models(spec, StateModel(), NoCommunication(), randomization=ranges)


def chosen_models(
    spec: TaskSpec,
    observation: Source | None = None,
    communication: Source | None = None,
    backend: str | None = None,
    randomization: Ranges | None = None,
    own: TaskSpec | None = None,
) -> TaskSpec:
    """Does what `with_models` does, and logs what that changes in a line of the level INFO."""
    own = spec if own is None else own
    found = with_models(spec, observation, communication, backend, randomization, own)
    if observation is not None or communication is not None:
        changes = [
            *_changes("observation", own.observation, found.observation),
            *_changes("communication", own.communication, found.communication),
            *_changes("randomization", own.randomization, found.randomization),
        ]
        _LOG.info("Changes to the task's own models: %s", ", ".join(changes) or "none")
    return found


def _changes(part: str, before: Frozen, after: Frozen) -> Iterator[str]:
    """What changed in a model; of another kind, both in words."""
    if type(before) is not type(after):
        yield f"{part} {_describe(before)} -> {_describe(after)}"
        return
    for name in type(before).model_fields:
        old, new = getattr(before, name), getattr(after, name)
        if isinstance(old, Frozen) and isinstance(new, Frozen):
            yield from _changes(f"{part}.{name}", old, new)
        elif old != new:
            yield f"{part}.{name} {_plain(old)} -> {_plain(new)}"


def models_of(spec: TaskSpec) -> dict[str, Any]:
    """Both models as JSON values, every default written out."""
    return {
        "communication": spec.communication.model_dump(mode="json"),
        "observation": spec.observation.model_dump(mode="json"),
    }


def describe(spec: TaskSpec) -> str:
    """Both models in words, with the values that are not defaults, for titles and messages."""
    seen, told = _describe(spec.observation), _describe(spec.communication)
    return f"observation {seen}, communication {told}"


def _describe(model: Frozen) -> str:
    given = model.model_dump(mode="json", exclude_defaults=True)
    given.pop("kind", None)
    kind = str(getattr(model, "kind", type(model).__name__))
    text = ", ".join(f"{name} {_plain(value)}" for name, value in given.items())
    return f"{kind} ({text})" if text else kind


def _plain(value: Any) -> str:
    if value is None:
        return "none"
    if isinstance(value, Frozen):
        value = value.model_dump(mode="json")
    if isinstance(value, Mapping):
        return " ".join(f"{name} {_plain(inner)}" for name, inner in value.items())
    return format(value, "g") if isinstance(value, float) else str(value)


def check_senses(
    policy: str, trained: TaskSpec, offered: TaskSpec, *features: "tuple[Feature, ...]"
) -> None:
    """Checks that a pair of models gives the inputs and messages that a policy was trained with.

    `features` are those of one robot's observation, trained and offered.

    Raises:
        PolicyFitError: the features or the lengths of actions differ.
    """
    known, seen = ([feature.name for feature in side] for side in features)
    if (known, trained.action_size) == (seen, offered.action_size):
        return
    raise PolicyFitError(
        f"{policy} was trained with {describe(trained)}: {len(known)} numbers per robot, actions "
        f"of {trained.action_size}. It cannot act with {describe(offered)}: {len(seen)} numbers, "
        f"actions of {offered.action_size}{_first_difference(known, seen)}. Evaluate it with "
        "models that give the same features (other noise, ranges and losses are fine), or train "
        "on these."
    )


def _first_difference(known: list[str], seen: list[str]) -> str:
    pairs = zip([*known, "nothing"], [*seen, "nothing"], strict=False)
    found = next(((k, a, b) for k, (a, b) in enumerate(pairs) if a != b), None)
    return "" if found is None else f"; number {found[0]} is {found[2]}, not {found[1]}"
