"""Checkpoints: one safetensors file of named tensors and JSON metadata, checked when read.

The file holds the SHA-256 of its own content, so that a damaged or half-copied file is an error and
never a slightly different policy. Nothing is pickled.
"""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import safetensors
from safetensors.torch import load as parse
from safetensors.torch import save as serialize
from torch import Tensor

from swarmdata.errors import CheckpointError
from swarmdata.runtime.atomic import write_file
from swarmdata.runtime.regular_files import read_regular

FORMAT = "swarmdata-checkpoint-1"

MAX_BYTES = 1 << 32
"""Of a checkpoint file."""


def save_checkpoint(path: Path, tensors: Mapping[str, Tensor], metadata: Mapping[str, Any]) -> str:
    """Writes tensors and JSON metadata atomically; returns the SHA-256 of the content, hex."""
    content = {name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}
    text = json.dumps(metadata, sort_keys=True)
    digest = _digest(content, text)
    # one entry: safetensors writes several in random order, and equal runs are to be equal files
    header = {FORMAT: json.dumps({"metadata": text, "sha256": digest})}
    write_file(path, serialize(content, header))
    return digest


def load_checkpoint(path: Path) -> tuple[dict[str, Tensor], dict[str, Any]]:
    """Reads a checkpoint: its tensors on the CPU, and its metadata."""
    try:
        data = read_regular(path, MAX_BYTES)
    except FileNotFoundError as error:
        raise CheckpointError(f"there is no checkpoint at {path}. Was the run started?") from error
    except OSError as error:
        raise CheckpointError(f"cannot read the checkpoint {path}: {error}") from error
    return parse_checkpoint(data, str(path))


def parse_checkpoint(data: bytes, source: str) -> tuple[dict[str, Tensor], dict[str, Any]]:
    """Reads the bytes of a checkpoint; errors are those of `load_checkpoint`."""
    try:
        tensors: dict[str, Tensor] = parse(data)
        header = _header(data)
        saved = json.loads(header[FORMAT]) if FORMAT in header else None
    except (safetensors.SafetensorError, ValueError) as error:
        raise CheckpointError(
            f"{source} is not a readable checkpoint ({error}). Copy it again from its source, or "
            "train again in another folder."
        ) from error
    if saved is None:
        raise CheckpointError(
            f"{source} has metadata {sorted(header)}, expected {FORMAT!r}: it was written by "
            "another program or another version of swarmdata, or it is damaged."
        )
    text = saved.get("metadata", "")
    if _digest(tensors, text) != saved.get("sha256"):
        raise CheckpointError(
            f"{source} is damaged: its content does not have the SHA-256 it was saved with. "
            "Copy it again from its source, or train again in another folder."
        )
    metadata: dict[str, Any] = json.loads(text)
    return tensors, metadata


def part(tensors: Mapping[str, Tensor], prefix: str) -> dict[str, Tensor]:
    """Returns the tensors named `prefix.*` without the prefix."""
    start = prefix + "."
    return {k.removeprefix(start): v for k, v in tensors.items() if k.startswith(start)}


def _header(data: bytes) -> dict[str, str]:
    """The text metadata of a safetensors file: 8 bytes of length, then JSON."""
    length = int.from_bytes(data[:8], "little")
    header: dict[str, str] = json.loads(data[8 : 8 + length]).get("__metadata__", {})
    return header


def _digest(tensors: Mapping[str, Tensor], text: str) -> str:
    """SHA-256 over the metadata and, in name order, name, dtype, shape and bytes of each tensor."""
    result = hashlib.sha256(text.encode())
    for name in sorted(tensors):
        array = tensors[name].numpy()
        result.update(f"\n{name} {array.dtype.str} {array.shape}\n".encode())
        result.update(np.ascontiguousarray(array).tobytes())
    return result.hexdigest()
