"""Policies as files: the weights of one seed's policy, and what it needs to act with them."""

from collections.abc import Callable, Mapping
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

from torch import Tensor

from swarmdata.errors import CheckpointError
from swarmdata.interfaces import Policy
from swarmdata.learn.choices.bins import BinPolicy
from swarmdata.learn.networks.perceptrons import Layer
from swarmdata.learn.policies.flow_policy import FlowPolicy
from swarmdata.learn.policies.latent_policy import LatentPolicy
from swarmdata.learn.policies.recurrent_flow_policy import RecurrentFlowPolicy
from swarmdata.learn.policies.recurrent_policy import RecurrentPolicy
from swarmdata.learn.policies.set_policy import SetPolicy
from swarmdata.learn.policies.torch_policy import TorchPolicy
from swarmdata.learn.training.checkpoint import load_checkpoint, save_checkpoint
from swarmdata.perception.feature_slots import Slots
from swarmdata.perception.frames import Frame

KINDS: dict[str, Callable[..., Policy]] = {
    kind.__name__: kind
    for kind in (
        TorchPolicy,
        BinPolicy,
        RecurrentPolicy,
        SetPolicy,
        FlowPolicy,
        RecurrentFlowPolicy,
        LatentPolicy,
    )
}
"""Policies that can be kept: dataclasses of layers, tensors, a frame, slots and JSON values."""


def save_policy(path: Path, policy: Policy) -> None:
    """Writes a policy of one of the `KINDS`, atomically; its folder is made if need be."""
    tensors: dict[str, Tensor] = {}
    metadata: dict[str, Any] = {"kind": type(policy).__name__}
    for field in fields(policy):  # type: ignore[arg-type]
        if not field.init:  # what a policy remembers of its last step
            continue
        value = getattr(policy, field.name)
        if field.name == "layers":
            for index, layer in enumerate(value):
                parts = layer._asdict().items()
                tensors |= {f"layers.{index}.{k}": v for k, v in parts if v is not None}
        elif isinstance(value, Tensor):
            tensors[field.name] = value
        elif isinstance(value, Frame | Slots):
            metadata[field.name] = asdict(value)
        else:
            metadata[field.name] = value
    path.parent.mkdir(parents=True, exist_ok=True)
    save_checkpoint(path, tensors, metadata)


def load_policy(path: Path) -> Policy:
    """Reads what `save_policy` wrote.

    Raises:
        CheckpointError: there is no such file, it is damaged, or it holds no policy.
    """
    tensors, metadata = load_checkpoint(path)
    if metadata.get("kind") not in KINDS:
        raise CheckpointError(f"{path} holds {metadata.get('kind')!r}, expected one of {[*KINDS]}")
    values: dict[str, Any] = {k: v for k, v in metadata.items() if k != "kind"}
    if "n_choices" in values:  # the name in older files
        values["n_bins"] = values.pop("n_choices")
    values |= {name: tensor for name, tensor in tensors.items() if "." not in name}
    values["layers"] = _layers(tensors)
    if frame := values.get("frame"):
        closing = tuple((near, speed) for near, speed in frame["closing"])
        heard = tuple((x, own, other) for x, own, other in frame.get("heard", ()))  # newer files
        values["frame"] = Frame(frame["anchor"], tuple(frame["vectors"]), closing, heard)
    if slots := values.get("slots"):
        values |= {"slots": Slots.parse(slots), "hidden": tuple(values["hidden"])}
    policy: Policy = KINDS[metadata["kind"]](**values)
    return policy


def _layers(tensors: Mapping[str, Tensor]) -> list[Layer]:
    n_layers = sum(name.endswith(".weight") for name in tensors)
    return [
        Layer(*(tensors.get(f"layers.{index}.{name}") for name in Layer._fields))  # type: ignore[arg-type]
        for index in range(n_layers)
    ]
