"""Policies as files: the weights of one seed's policy, and what it needs to act with them.

Tensors lie in the file under the names of a policy's fields, `layers.0.weight` those of layers,
those of a dataclass inside under `chooser.layers.0.weight`, and those in a list of a user's policy
under `weights.0`; all else is in the metadata.
"""

from collections.abc import Callable, Mapping
from dataclasses import asdict, fields, is_dataclass
from pathlib import Path
from typing import Any

from torch import Tensor

from swarmdata.errors import CheckpointError
from swarmdata.interfaces import Policy
from swarmdata.learn.choices.behavior_heads import Rule
from swarmdata.learn.choices.choices import Choices
from swarmdata.learn.networks.perceptrons import Layer
from swarmdata.learn.policies.choice_policy import BinPolicy, ChoicePolicy, RecurrentChoicePolicy
from swarmdata.learn.policies.drawn_policy import FlowPolicy, LatentPolicy, RecurrentFlowPolicy
from swarmdata.learn.policies.recurrent_policy import RecurrentPolicy
from swarmdata.learn.policies.sequence_policy import SequencePolicy
from swarmdata.learn.policies.torch_policy import SetPolicy, TorchPolicy
from swarmdata.learn.training.checkpoint import load_checkpoint, parse_checkpoint, save_checkpoint
from swarmdata.learn.training.run_files import POLICIES, last_policy_path
from swarmdata.perception.feature_slots import Slots
from swarmdata.perception.frames import NO_HEADING, Frame, current_fields
from swarmdata.runtime.own_components import components, defined_elsewhere, import_component

KINDS: dict[str, Callable[..., Policy]] = {
    kind.__name__: kind
    for kind in (
        TorchPolicy, BinPolicy, ChoicePolicy, RecurrentPolicy, RecurrentChoicePolicy, SetPolicy,
        FlowPolicy, RecurrentFlowPolicy, LatentPolicy, SequencePolicy,
    )
}  # fmt: skip
"""Policies of this package that can be kept."""

PARTS: dict[str, Callable[..., Any]] = {
    kind.__name__: kind for kind in (Choices, Rule, ChoicePolicy)
}
"""Dataclasses inside policies."""

LAYER_FIELDS = ("layers", "behavior", "gates")
"""Names of the fields that hold layers."""


def save_policy(path: Path, policy: Policy) -> None:
    """Writes a policy atomically; its folder is made if need be.

    Raises:
        CheckpointError: the policy is none of the `KINDS`, and of no class that an online algorithm
            of a user declares as its `POLICIES`; or a field has what files do not hold.
    """
    kind, tensors = _kind_of(policy), dict[str, Tensor]()
    metadata = _encoded(policy, "", tensors) | {"kind": kind}
    path.parent.mkdir(parents=True, exist_ok=True)
    save_checkpoint(path, tensors, metadata)


def _kind_of(policy: Any) -> str:
    """The name of a policy's class in files: that of a user's follows that of the algorithm."""
    kind = type(policy)
    name: str = kind.__name__
    if KINDS.get(name) is kind:
        return name
    for algorithm in components("online_algorithms"):
        if kind in _own_kinds(algorithm).values() and is_dataclass(policy):
            return f"{algorithm}.{name}"
    raise CheckpointError(
        f"a policy of class {name} cannot be written to a file, expected one of "
        f"{', '.join(KINDS)}, or a dataclass among the POLICIES of a registered online algorithm"
    )


def _own_kinds(algorithm: str) -> dict[str, Callable[..., Any]]:
    """The classes that an online algorithm of a user declares as those of its policies, by name."""
    component = import_component(components("online_algorithms")[algorithm])
    return {kind.__name__: kind for kind in getattr(component, "POLICIES", ())}


def _encoded(value: Any, prefix: str, tensors: dict[str, Tensor]) -> dict[str, Any]:
    """Returns the metadata of a dataclass, and puts its tensors into `tensors`."""
    metadata: dict[str, Any] = {"kind": type(value).__name__}
    for field in fields(value):
        if not field.init:  # what a policy remembers of its last step
            continue
        name, content = f"{prefix}{field.name}", getattr(value, field.name)
        if field.name in LAYER_FIELDS and _are_layers(content):
            for index, layer in enumerate(content):
                parts = layer._asdict().items()
                tensors |= {f"{name}.{index}.{k}": v for k, v in parts if v is not None}
        elif isinstance(content, Tensor):
            tensors[name] = content
        elif isinstance(content, Frame | Slots):
            metadata[field.name] = asdict(content)
        elif type(content).__name__ in PARTS:
            metadata[field.name] = _encoded(content, f"{name}.", tensors)
        elif isinstance(value, ChoicePolicy) and field.name == "ranges":
            metadata["ranges"] = [[[r.start, r.stop] for r in agent] for agent in content]
        else:
            metadata[field.name] = _plain(content, name, tensors)
    return metadata


def _are_layers(content: Any) -> bool:
    return isinstance(content, list | tuple) and all(isinstance(each, Layer) for each in content)


def _plain(content: Any, name: str, tensors: dict[str, Tensor]) -> Any:
    """Returns what JSON holds of a field: of a tensor in a list, the name that it gets."""
    if isinstance(content, list | tuple):
        return [_plain(each, f"{name}.{k}", tensors) for k, each in enumerate(content)]
    if isinstance(content, Tensor):
        tensors[name] = content
        return {"tensor": name}
    if name == "kind" or not isinstance(content, str | int | float | dict | None):
        raise CheckpointError(
            f"the field {name!r} of a policy is {content!r:.100}, expected a tensor, number, text "
            "or list of these, and another name than 'kind', which files need for the class"
        )
    return content


def _whole(content: Any, tensors: Mapping[str, Tensor]) -> Any:
    """Undoes `_plain`."""
    if isinstance(content, list):
        return [_whole(each, tensors) for each in content]
    if isinstance(content, Mapping) and content.keys() == {"tensor"}:
        return tensors[content["tensor"]]
    return content


def load_policy(path: Path) -> Policy:
    """Reads what `save_policy` wrote.

    Raises:
        CheckpointError: there is no such file, it is damaged, or it holds no policy.
    """
    return _policy(*load_checkpoint(path), str(path))


def last_policy(run: Path, seed: int) -> Policy:
    """The newest policy of a seed of an online run, or of one of the runs inside a folder.

    Raises:
        BuildError: there is none.
    """
    inside = sorted(run.glob(f"seeds-*/{POLICIES}/seed-{seed}"))
    folder = inside[0].parent.parent if inside else run
    return load_policy(last_policy_path(folder, seed))


def parse_policy(data: bytes, source: str) -> Policy:
    """Reads the bytes that `save_policy` wrote; errors are those of `load_policy`."""
    return _policy(*parse_checkpoint(data, source), source)


def _policy(tensors: Mapping[str, Tensor], metadata: Mapping[str, Any], source: str) -> Policy:
    kind = str(metadata.get("kind"))
    algorithm, _, name = kind.rpartition(".")
    if algorithm and algorithm not in components("online_algorithms"):
        what = defined_elsewhere("a policy of the online algorithm", algorithm)
        raise CheckpointError(f"{source} holds {what}")
    kinds = _own_kinds(algorithm) if algorithm else KINDS
    if name not in kinds:
        raise CheckpointError(f"{source} holds {kind!r}, expected one of {[*kinds]}")
    try:
        policy: Policy = _decoded({**metadata, "kind": name}, "", tensors, kinds)
    except (KeyError, TypeError, ValueError) as error:
        raise CheckpointError(
            f"{source} holds a {kind} that this version cannot read: {error!r}"
        ) from error
    return policy


def _decoded(
    metadata: Mapping[str, Any],
    prefix: str,
    tensors: Mapping[str, Tensor],
    kinds: Mapping[str, Callable[..., Any]],
) -> Any:
    """Returns the dataclass that `_encoded` took apart."""
    kind = kinds[metadata["kind"]]
    own = {k.removeprefix(prefix): v for k, v in tensors.items() if k.startswith(prefix)}
    values: dict[str, Any] = {k: _whole(v, tensors) for k, v in metadata.items() if k != "kind"}
    expected = {field.name for field in fields(kind)}  # type: ignore[arg-type]
    if "n_bins" in expected and "n_choices" in values:  # the name in older files
        values["n_bins"] = values.pop("n_choices")
    for name, content in values.items():
        if isinstance(content, Mapping) and content.get("kind") in PARTS:
            values[name] = _decoded(content, f"{prefix}{name}.", tensors, PARTS)
    values |= {name: tensor for name, tensor in own.items() if "." not in name}
    values |= {name: _layers(own, name) for name in LAYER_FIELDS if name in expected - {*values}}
    if isinstance(values.get("frame"), Mapping):
        frame = current_fields(values["frame"])
        closing = tuple((near, speed) for near, speed in frame["closing"])
        heard = tuple((x, robot, other) for x, robot, other in frame.get("heard", ()))  # newer
        values["frame"] = Frame(
            frame["anchor"], tuple(frame["vectors"]), closing, heard,
            frame.get("heading", NO_HEADING), tuple(frame.get("holonomic", ())),
        )  # fmt: skip
    if isinstance(slots := values.get("slots"), Mapping):
        values |= {"slots": Slots.parse(slots), "hidden": tuple(values["hidden"])}
    if kind is ChoicePolicy:
        values["ranges"] = tuple(tuple(range(*r) for r in agent) for agent in values["ranges"])
    return kind(**values)


def _layers(tensors: Mapping[str, Tensor], field: str) -> list[Layer]:
    names = [f"{field}.{index}" for index in range(len(tensors))]
    return [
        Layer(*(tensors.get(f"{name}.{part}") for part in Layer._fields))  # type: ignore[arg-type]
        for name in names
        if f"{name}.weight" in tensors
    ]
