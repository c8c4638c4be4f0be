"""The sample of episodes: its size, the share of every policy and outcome, and their order."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from swarmdata.catalogue.replays.data_files import choose_episodes
from tests.support.episode_table import episode_table


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
