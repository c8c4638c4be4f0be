"""The map between an environment's actions and [-1, 1]."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmdata.errors import SchemaError
from swarmdata.specs.action_scaling import action_scale, choices_of, has_choices
from swarmdata.specs.origins import RecordedAgent, RecordedSpec
from swarmdata.specs.spaces import (
    BoxSpace,
    DictSpace,
    DiscreteSpace,
    MultiBinarySpace,
    MultiDiscreteSpace,
    Space,
    TupleSpace,
    is_continuous,
)

SEEN = BoxSpace(shape=(1,), dtype="float32")


def spec_of(*spaces: Space) -> RecordedSpec:
    agents = tuple(
        RecordedAgent(name=f"a{k}", observation=SEEN, action=space)
        for k, space in enumerate(spaces)
    )
    return RecordedSpec(task="t", agents=agents, state_size=1, state_from="environment")


def box(low: float, high: float, n: int = 1) -> BoxSpace:
    return BoxSpace(shape=(n,), dtype="float32", low=low, high=high)


narrow = st.floats(-100, 100, width=32)


@given(low=narrow, span=st.floats(0.125, 100, width=32), shares=st.lists(st.floats(0, 1)))
def test_there_and_back(low: float, span: float, shares: list[float]) -> None:
    high = float(np.float32(low + span))
    scale = action_scale(spec_of(box(low, high)))
    actions = np.clip(np.array([low + s * (high - low) for s in [0, 1, *shares]]), low, high)
    rows = actions.astype(np.float32)[:, None, None]
    unit = scale.to_unit(rows)
    assert unit[:2].ravel().tolist() == [-1, 1]
    assert np.abs(unit).max() <= 1
    back = scale.to_environment(unit)
    np.testing.assert_allclose(back, rows, rtol=1e-5, atol=1e-5)
    assert (back >= np.float32(low)).all()
    assert (back <= np.float32(high)).all()


def test_padding_and_constants_are_zero() -> None:
    scale = action_scale(spec_of(box(0, 4, 2), box(3, 3)))
    actions = np.array([[0, 2], [3, 0]], np.float32)
    assert scale.to_unit(actions).tolist() == [[-1, 0], [0, 0]]
    unit = np.array([[1, -1], [0, 0.5]], np.float32)
    assert scale.to_environment(unit)[0].tolist() == [4, 0]


def test_what_is_continuous() -> None:
    choice = DiscreteSpace(n=2)
    assert is_continuous(TupleSpace(spaces=(box(0, 1), DictSpace(spaces={"x": box(0, 1)}))))
    assert not is_continuous(TupleSpace(spaces=(box(0, 1), choice)))
    assert not is_continuous(BoxSpace(shape=(2,), dtype="int64", low=0, high=3))
    assert has_choices(spec_of(box(0, 1), choice)) == ("a1",)
    with pytest.raises(SchemaError, match="actions of a1 in t are choices"):
        action_scale(spec_of(box(0, 1), choice))
    with pytest.raises(SchemaError, match="column 1 of the actions of a0 in t has the bounds -inf"):
        action_scale(spec_of(BoxSpace(shape=(2,), dtype="float32", low=(0.0, None), high=1.0)))


def test_choices_are_whole_numbers_by_column() -> None:
    many, bits = MultiDiscreteSpace(n=(2, 3)), MultiBinarySpace(n=2)
    both = DictSpace(spaces={"z": DiscreteSpace(n=4, start=-1), "a": TupleSpace(spaces=(bits,))})
    assert choices_of(spec_of(many, both)) == (
        (range(2), range(3)),
        (range(2), range(2), range(-1, 3)),  # entries in the order of their keys
    )
    assert choices_of(spec_of(box(0, 1))) == ()


@pytest.mark.parametrize("mixed", [box(0, 1), TupleSpace(spaces=(DiscreteSpace(n=2), box(0, 1)))])
def test_choices_beside_numbers_are_refused(mixed: Space) -> None:
    with pytest.raises(SchemaError, match="actions of a1 in t have a continuous part"):
        choices_of(spec_of(DiscreteSpace(n=2), mixed))
