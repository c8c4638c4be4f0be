from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarmdata.errors import SchemaError, SpecError
from swarmdata.specs.recipe import Splits
from swarmdata.store import SPLITS, merge_order, split_codes
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
    assert merge.n_steps == sum(steps)
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


def test_each_block_has_its_held_out_episodes() -> None:
    recipe = make_recipe(10, n_policies=2).model_copy(
        update={"splits": Splits(block=10, validation=2, test=3)}
    )
    order = [(p, e) for e in range(200) for p in range(2)]
    codes = split_codes(recipe, order)
    for policy in range(2):
        blocks = codes[policy::2].reshape(20, 10)
        assert (np.sum(blocks == SPLITS.index("validation"), axis=1) == 2).all()
        assert (np.sum(blocks == SPLITS.index("test"), axis=1) == 3).all()
        assert len({tuple(block) for block in blocks}) > 10
    assert not np.array_equal(codes[0::2], codes[1::2])


def test_every_position_can_be_held_out() -> None:
    codes = split_codes(make_recipe(10, block=5), [(0, e) for e in range(2000)]).reshape(400, 5)
    for code in (1, 2):
        counts = (codes == code).sum(axis=0)
        assert counts.sum() == 400
        # 80 expected with a deviation of 8; five of them bound the chance of a false alarm
        assert (np.abs(counts - 80) < 40).all()


def test_splits_do_not_depend_on_the_other_episodes() -> None:
    recipe = make_recipe(10, n_policies=2)
    order = [(1, 3), (0, 0), (0, 17), (1, 40)]
    alone = [int(split_codes(recipe, [one])[0]) for one in order]
    assert split_codes(recipe, order).tolist() == alone


def test_other_seeds_give_other_splits() -> None:
    order = [(0, e) for e in range(100)]
    first, second = (split_codes(make_recipe(10, seed=seed), order) for seed in (0, 1))
    assert not np.array_equal(first, second)


def test_a_rule_without_train_episodes_is_refused() -> None:
    with pytest.raises(SpecError, match="less than block"):
        Splits.parse({"block": 3, "validation": 2, "test": 1})
