from fractions import Fraction

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarmdata.errors import SchemaError
from swarmdata.store.episode_order import merge_order
from swarmdata.testing.synthetic import make_recipe

streams = st.lists(st.lists(st.integers(1, 30), min_size=1, max_size=25), min_size=1, max_size=4)


@settings(deadline=None)
@given(lengths=streams, n_steps=st.integers(1, 400))
def test_every_choice_is_the_policy_that_lags_most(lengths: list[list[int]], n_steps: int) -> None:
    recipe = make_recipe(n_steps, n_policies=len(lengths))
    merge = merge_order(recipe, lengths)
    shares = [Fraction(policy.share) for policy in recipe.policies]
    steps = [0] * len(lengths)
    taken = [0] * len(lengths)

    def next_policy() -> int:
        lags = [s / sum(shares) * sum(steps) - n for s, n in zip(shares, steps, strict=True)]
        return lags.index(max(lags))

    for policy, episode in merge.order:
        assert sum(steps) < n_steps
        assert policy == next_policy()
        assert episode == taken[policy]
        taken[policy] += 1
        steps[policy] += lengths[policy][episode]
    if merge.lacking is None:
        assert sum(steps) >= n_steps
    else:
        assert sum(steps) < n_steps
        assert merge.lacking == next_policy()
        assert taken[merge.lacking] == len(lengths[merge.lacking])


@settings(deadline=None)
@given(lengths=streams, n_steps=st.integers(2, 400), data=st.data())
def test_smaller_recipe_is_a_prefix(
    lengths: list[list[int]], n_steps: int, data: st.DataObject
) -> None:
    fewer = data.draw(st.integers(1, n_steps))
    large = merge_order(make_recipe(n_steps, len(lengths)), lengths).order
    small = merge_order(make_recipe(fewer, len(lengths)), lengths).order
    assert large[: len(small)] == small


@pytest.mark.parametrize("lengths", [[], [[1], [2]], [[3, 0]]])
def test_impossible_lengths_are_refused(lengths: list[list[int]]) -> None:
    with pytest.raises(SchemaError, match="merge_order got"):
        merge_order(make_recipe(10), lengths)
