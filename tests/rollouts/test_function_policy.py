"""FunctionPolicy: keeps the contract of policies, and refuses what is no joint action."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarmdata import FunctionPolicy, make_env
from swarmdata.errors import SchemaError
from swarmdata.record import step_of
from swarmdata.rollouts.function_policy import frame_of
from swarmdata.specs.origins import RecordedAgent, RecordedSpec
from swarmdata.specs.spaces import BoxSpace
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.testing.policy_contract import check_policy
from swarmdata.types import Float, Step

SPEC = TaskSpec(horizon=5)


def first_step(n_copies: int = 3) -> Step:
    return make_env(SPEC, n_copies).reset(np.arange(n_copies, dtype=np.uint64))


def drive(observations: Float) -> Float:
    return np.sin(3 * observations[..., :2])


def test_it_is_a_policy_that_acts_as_the_function_says() -> None:
    policy, step = FunctionPolicy(drive), first_step()
    actions = policy.act(step)
    assert np.array_equal(actions, np.sin(3 * step.observations[..., :2]).astype(np.float32))
    assert np.array_equal(policy.actions(step.observations), actions), "of recorded states, too"
    assert not policy.log_probs(step, actions).any()  # it is sure of what it does
    assert np.isneginf(policy.log_probs(step, np.float32(0.5) * actions)).all()


def test_it_keeps_the_contract() -> None:
    check_policy(FunctionPolicy(drive), SPEC, make_env)


@settings(deadline=None, max_examples=20)
@given(value=st.floats(-1e30, 1e30))
def test_actions_are_clipped(value: float) -> None:
    step = first_step()
    policy = FunctionPolicy(lambda seen: np.full((*seen.shape[:2], 2), value))
    actions = policy.act(step)
    assert np.array_equal(actions, np.full_like(actions, np.clip(value, -1, 1)))
    assert not FunctionPolicy(policy._function).log_probs(step, actions).any()


def in_bounds(low: float, high: float) -> RecordedSpec:
    """Two agents whose actions have one column with these bounds."""
    box = BoxSpace(shape=(1,), dtype="float32", low=low, high=high)
    agents = [RecordedAgent(name=name, observation=box, action=box) for name in ("a", "b")]
    data = {"task": "other", "agents": agents, "state_size": 1, "state_from": "environment"}
    return RecordedSpec.parse(data)


def test_a_function_in_the_units_of_an_environment_acts_in_unit_actions() -> None:
    step = step_of(np.zeros((2, 1), np.float32), np.zeros(1, np.float32), seed=0, time=0)
    policy = FunctionPolicy(lambda _: np.array([[[3.0], [9.0]]]), units=in_bounds(2, 6))
    actions = policy.act(step)
    assert actions.tolist() == [[[-0.5], [1.0]]], "the second is clipped to its bounds"
    assert not policy.log_probs(step, actions).any()
    wide = FunctionPolicy(lambda _: np.zeros((1, 2, 3)), units=in_bounds(2, 6))
    with pytest.raises(SchemaError, match=r"shape \(1, 2, 3\) .* expected \(1, 2, 1\)"):
        wide.act(step)


SHAPES = ((3, 2), (3, 4), (12, 2), (1, 4, 2), (3, 4, 2, 1))


@pytest.mark.parametrize(
    ("actions", "message"),
    [
        *((np.zeros(shape), "one action of each robot in each copy") for shape in SHAPES),
        *((np.full((3, 4, 2), value), "not finite") for value in (np.nan, np.inf)),
    ],
)
def test_what_is_no_joint_action_is_refused(actions: Any, message: str) -> None:
    with pytest.raises(SchemaError, match=message):
        FunctionPolicy(lambda _: actions).act(first_step())


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"frame": "target"}, r"frame is 'target', expected a Frame .*frame_of\(dataset.spec"),
        ({"units": "m/s"}, r"units is 'm/s', expected a spec .* units=dataset.spec"),
        ({"function": 3}, "the policy is 3, expected a function"),
    ],
)
def test_arguments_of_another_type_are_refused(arguments: Any, message: str) -> None:
    with pytest.raises(SchemaError, match=message):
        FunctionPolicy(**{"function": drive, **arguments})


def test_tensors_are_taken() -> None:
    torch = pytest.importorskip("torch")
    step = first_step()
    policy = FunctionPolicy(lambda seen: torch.from_numpy(seen)[..., :2].tanh())
    expected = np.tanh(step.observations[..., :2])
    np.testing.assert_allclose(policy.act(step), expected, atol=1e-6)


def test_a_function_sees_and_acts_in_its_frame() -> None:
    step, frame = first_step(), frame_of(SPEC)
    assert frame is not None
    seen: list[Float] = []

    def ahead(observations: Float) -> Float:
        seen.append(observations)
        return np.broadcast_to(np.array([1, 0], np.float32), (*observations.shape[:2], 2))

    actions = FunctionPolicy(ahead, frame=frame).act(step)
    assert np.array_equal(seen[0], frame.inputs(step.observations))
    x, y = frame.directions(step.observations)
    assert np.allclose(actions, np.stack([x, y], -1), atol=1e-6)
    assert not np.allclose(actions, FunctionPolicy(ahead).act(step))
