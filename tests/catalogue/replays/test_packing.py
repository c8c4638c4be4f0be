"""Packed integers come back exactly, and smooth columns are small."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from swarmdata.catalogue.replays.packing import pack
from tests.support.packed import unpack

BLOCKS = arrays(
    np.int16, array_shapes(min_dims=2, max_dims=2, max_side=9), elements=st.integers(-32768, 32767)
)


@given(blocks=st.lists(BLOCKS, max_size=3), order=st.integers(0, 2))
def test_blocks_come_back(blocks: list[np.ndarray], order: int) -> None:
    found = unpack(pack(blocks, order), [block.shape for block in blocks], order)

    for block, back in zip(blocks, found, strict=True):
        np.testing.assert_array_equal(back, block)


def test_smooth_columns_take_less_than_a_byte_a_number() -> None:
    time = np.arange(2000)[:, None]
    block = np.rint(1000 * np.sin(time / 40 + np.arange(8))).astype(np.int16)

    assert len(pack([block])) < 0.7 * block.size
