"""Every block of a policy's episodes has its held-out ones, whatever else is in the dataset."""

import numpy as np
import pytest

from swarmdata.errors import SpecError
from swarmdata.specs.recipe import Splits
from swarmdata.store import SPLITS
from swarmdata.store.split_rule import assign_splits
from swarmdata.testing.synthetic import make_recipe


def test_each_block_has_its_held_out_episodes() -> None:
    recipe = make_recipe(10, n_policies=2).model_copy(
        update={"splits": Splits(block=10, validation=2, test=3)}
    )
    order = [(p, e) for e in range(200) for p in range(2)]
    codes = assign_splits(recipe, order)
    for policy in range(2):
        blocks = codes[policy::2].reshape(20, 10)
        assert (np.sum(blocks == SPLITS.index("validation"), axis=1) == 2).all()
        assert (np.sum(blocks == SPLITS.index("test"), axis=1) == 3).all()
        assert len({tuple(block) for block in blocks}) > 10
    assert not np.array_equal(codes[0::2], codes[1::2])


def test_every_position_can_be_held_out() -> None:
    codes = assign_splits(make_recipe(10, block=5), [(0, e) for e in range(2000)]).reshape(400, 5)
    for code in (1, 2):
        counts = (codes == code).sum(axis=0)
        assert counts.sum() == 400
        # 80 expected with a deviation of 8; five of them bound the chance of a false alarm
        assert (np.abs(counts - 80) < 40).all()


def test_splits_do_not_depend_on_the_other_episodes() -> None:
    recipe = make_recipe(10, n_policies=2)
    order = [(1, 3), (0, 0), (0, 17), (1, 40)]
    alone = [int(assign_splits(recipe, [one])[0]) for one in order]
    assert assign_splits(recipe, order).tolist() == alone


def test_other_seeds_give_other_splits() -> None:
    order = [(0, e) for e in range(100)]
    first, second = (assign_splits(make_recipe(10, seed=seed), order) for seed in (0, 1))
    assert not np.array_equal(first, second)


def test_a_rule_without_train_episodes_is_refused() -> None:
    with pytest.raises(SpecError, match="less than block"):
        Splits.parse({"block": 3, "validation": 2, "test": 1})
