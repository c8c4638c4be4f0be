"""What robots choose from: bins, recorded choices, robots that differ, and action masks."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from swarmdata.errors import SchemaError
from swarmdata.learn.choices.choices import Choices, columns_of
from swarmdata.learn.networks.setup import Sizes

CONTINUOUS = Sizes(n_agents=3, observation=4, action=2, state=5)
UNEQUAL = ((range(3), range(2)), (range(1, 5),))  # robot 1 has one column, from 1 to 4
RECORDED = Sizes(n_agents=2, observation=4, action=2, state=5, choices=UNEQUAL)


@settings(deadline=None, max_examples=30)
@given(st.integers(2, 17), st.integers(0, 999))
def test_weights_value_actions_as_interpolation_does(n_bins: int, seed: int) -> None:
    generator = torch.Generator().manual_seed(seed)
    choices = Choices.of(CONTINUOUS, n_bins)
    actions = torch.rand(6, 3, 2, generator=generator) * 2.4 - 1.2
    utilities = torch.randn(6, 3, 2, n_bins, generator=generator)
    weights = choices.weights(actions)
    assert (weights >= 0).all()
    assert ((weights > 0).sum(-1) <= 2).all()
    torch.testing.assert_close(weights.sum(-1), torch.ones(6, 3, 2))
    valued = (utilities * weights).sum(-1).mean(-1)
    columns = [
        np.interp(a, np.linspace(-1, 1, n_bins), u)
        for a, u in zip(actions.flatten(), utilities.flatten(0, 2), strict=True)
    ]
    expected = torch.tensor(np.array(columns), dtype=torch.float32).view(6, 3, 2).mean(-1)
    torch.testing.assert_close(valued, expected, rtol=1e-4, atol=1e-5)
    # the mean bin is the action itself
    inside = actions.clamp(-1, 1)
    torch.testing.assert_close((weights * choices.values.float()).sum(-1), inside)


def test_recorded_choices_keep_their_numbers() -> None:
    choices = Choices.of(RECORDED, 9)
    assert (choices.n_columns, choices.n_choices) == (2, 4)
    assert choices.exists is not None
    assert choices.exists.sum(-1).tolist() == [[3, 2], [4, 1]]
    recorded = torch.tensor([[[2.0, 1.0], [4.0, 0.0]], [[0.0, 0.0], [1.0, 0.0]]])
    weights = choices.weights(recorded)
    assert weights.argmax(-1).tolist() == [[[2, 1], [3, 0]], [[0, 0], [0, 0]]]
    assert torch.equal(weights.sum(-1), torch.ones(2, 2, 2))
    assert torch.equal(choices.to_actions(weights), recorded.double())


def test_who_has_left_counts_as_the_first_choice() -> None:
    gone = torch.zeros(1, 2, 2)  # robot 1 chooses from 1 on
    assert Choices.of(RECORDED, 9).weights(gone).argmax(-1).tolist() == [[[0, 0], [0, 0]]]


def test_too_many_combinations_are_refused() -> None:
    assert Choices.of(CONTINUOUS, 9).n_combinations == 81
    with pytest.raises(SchemaError, match="65 choices in 2 columns have 4,225 combinations"):
        _ = Choices.of(CONTINUOUS, 65).n_combinations


def test_masks_are_split_into_columns() -> None:
    joined = torch.tensor([[True, False, True, False, True], [False, True, True, False, False]])
    masks = columns_of(joined, UNEQUAL, 2)
    assert masks.tolist() == [
        [[True, False, True, False], [False, True, False, False]],
        [[False, True, True, False], [True, False, False, False]],
    ]
