"""Integers as `assets/data.js` of the catalogue unpacks them."""

import base64
import gzip
from collections.abc import Sequence

import numpy as np

from swarmdata.types import Int


def unpack(text: str, shapes: Sequence[tuple[int, int]], order: int = 2) -> list[Int]:
    """The blocks, (T, C) each, that `pack` packed with an order of differences."""
    raw = np.frombuffer(gzip.decompress(base64.b64decode(text)), np.uint8).astype(np.int64)
    codes = raw[: len(raw) // 2] | raw[len(raw) // 2 :] << 8
    values, blocks, first = (codes >> 1) ^ -(codes & 1), [], 0
    for rows, columns in shapes:
        block = values[first : first + rows * columns].reshape(columns, rows).T
        first += rows * columns
        for _ in range(order):
            block = block.cumsum(axis=0)
        blocks.append(block.astype(np.int16).astype(np.int64))
    return blocks
