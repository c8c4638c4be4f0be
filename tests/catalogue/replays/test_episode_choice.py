"""The sample of episodes: its size, the share of every policy and outcome, and their order."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from swarmdata.catalogue.replays.episode_choice import choose_episodes
from swarmdata.store import EpisodeTable


def table_of(policy: list[int], end_reason: list[int]) -> EpisodeTable:
    n = len(policy)
    ones, flags = np.ones(n, np.int64), np.zeros(n, np.bool_)
    return EpisodeTable(
        starts=ones,
        lengths=ones,
        seeds=ones.astype(np.uint64),
        layouts=np.zeros((n, 0, 8), np.float32),
        split=np.zeros(n, np.uint8),
        end_reason=np.array(end_reason, np.uint8),
        policy=np.array(policy, np.uint8),
        policy_episode=ones,
        team_return=np.zeros(n),
        success=flags,
        robot_collisions=ones,
        obstacle_collisions=ones,
    )


@given(
    kinds=st.lists(st.tuples(st.integers(0, 3), st.integers(0, 2)), min_size=1, max_size=80),
    most=st.integers(1, 40),
)
def test_the_sample_has_the_size_asked_for_in_stored_order(
    kinds: list[tuple[int, int]], most: int
) -> None:
    table = table_of([policy for policy, _ in kinds], [end for _, end in kinds])

    found = choose_episodes(table, most)

    assert len(found) == min(most, len(kinds))
    assert (np.diff(found) > 0).all()


def test_every_kind_has_its_share() -> None:
    table = table_of([0] * 600 + [1] * 390 + [2] * 10, [0] * 1000)

    found = choose_episodes(table, 100)

    assert np.bincount(table.policy[found]).tolist() == [60, 39, 1]


def test_a_rare_outcome_is_not_lost() -> None:
    table = table_of([0] * 1000, [0] * 999 + [1])

    assert 999 in choose_episodes(table, 10)


def test_the_sample_is_spread_over_the_dataset() -> None:
    found = choose_episodes(table_of([0] * 100, [0] * 100), 10)

    assert found.tolist() == list(range(0, 100, 10))


def test_none_means_all() -> None:
    assert len(choose_episodes(table_of([0] * 7, [0] * 7), None)) == 7
