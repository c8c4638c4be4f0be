"""Packs integers into text: second differences, zigzag, split bytes, gzip, base64.

Positions of robots change smoothly, so their second differences are small: most fit in one byte,
and the plane of high bytes is almost empty. Data files are scripts that call a function with this
text, because pages at `file://` may load scripts but may not fetch.
"""

import base64
import gzip
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from swarmdata.types import Int

Packable = NDArray[np.integer]


def pack(blocks: Sequence[Packable], order: int = 2) -> str:
    """Packs blocks of integers, one after the other, without their shapes.

    Args:
        blocks: each [T, C], of 16 bits; other values wrap.
        order: how many times columns are replaced by their differences along time.

    Returns:
        Base64 of the gzip of all low bytes, then all high bytes. Values are column after column,
        and zigzag encoded: 0, -1, 1, -2 are 0, 1, 2, 3.
    """
    columns = [_differences(block, order).T.ravel() for block in blocks]
    values = np.concatenate(columns).astype(np.int16) if columns else np.zeros(0, np.int16)
    codes = ((values << 1) ^ (values >> 15)).astype(np.uint16)
    split = (codes & 255).astype(np.uint8).tobytes() + (codes >> 8).astype(np.uint8).tobytes()
    return base64.b64encode(gzip.compress(split, 9, mtime=0)).decode()


def unpack(text: str, shapes: Sequence[tuple[int, int]], order: int = 2) -> list[Int]:
    """Returns the blocks that `pack` packed; `assets/data.js` does the same.

    Args:
        text: packed.
        shapes: of the blocks, (T, C) each.
        order: as of `pack`.
    """
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


def _differences(block: Packable, order: int) -> Packable:
    found = block.astype(np.int64)
    for _ in range(order):
        found = np.diff(found, axis=0, prepend=0)
    return found
