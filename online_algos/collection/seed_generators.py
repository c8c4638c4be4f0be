"""One NumPy generator for each seed: their draws, and their states as tensors."""

import json
from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from swarmdata.types import Float


def standard_normal(generators: Sequence[np.random.Generator], shape: tuple[int, ...]) -> Float:
    """Returns standard normal numbers, [K, *shape], those of a seed from its own generator."""
    return np.stack([g.standard_normal(shape, dtype=np.float32) for g in generators])


def pack_generators(generators: Sequence[np.random.Generator]) -> Tensor:
    """Returns the states of some generators as bytes, uint8."""
    text = json.dumps([generator.bit_generator.state for generator in generators])
    return torch.from_numpy(np.frombuffer(text.encode(), np.uint8).copy())


def unpack_generators(packed: Tensor, generators: Sequence[np.random.Generator]) -> None:
    """Restores what `pack_generators` returned."""
    states = json.loads(packed.numpy().tobytes())
    for generator, state in zip(generators, states, strict=True):
        generator.bit_generator.state = state
