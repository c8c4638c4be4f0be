"""The sample of episodes to show, and their packed numbers, which come back exactly."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from swarmdata.catalogue.replays.data_files import choose_episodes, pack
from tests.support.episode_table import episode_table
from tests.support.packed import unpack


@given(
    kinds=st.lists(st.tuples(st.integers(0, 3), st.integers(0, 2)), min_size=1, max_size=80),
    most=st.integers(1, 40),
)
def test_the_sample_has_the_size_asked_for_in_stored_order(
    kinds: list[tuple[int, int]], most: int
) -> None:
    policies, ends = zip(*kinds, strict=True)
    table = episode_table(len(kinds), policy=policies, end_reason=ends)

    found = choose_episodes(table, most)

    assert len(found) == min(most, len(kinds))
    assert (np.diff(found) > 0).all()
    assert len(choose_episodes(table, None)) == len(kinds)


def test_every_kind_has_its_share_and_is_spread_over_the_dataset() -> None:
    table = episode_table(1000, policy=[0] * 600 + [1] * 390 + [2] * 10)
    assert np.bincount(table.policy[choose_episodes(table, 100)]).tolist() == [60, 39, 1]
    rare = episode_table(1000, end_reason=[0] * 999 + [1])
    assert 999 in choose_episodes(rare, 10)
    assert choose_episodes(episode_table(100), 10).tolist() == list(range(0, 100, 10))


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
