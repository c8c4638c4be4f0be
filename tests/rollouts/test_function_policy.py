"""FunctionPolicy: keeps the contract of policies, and refuses what is no joint action."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarmdata import FunctionPolicy, make_env
from swarmdata.errors import SchemaError
from swarmdata.interfaces import Policy
from swarmdata.rollouts.function_policy import frame_of
from swarmdata.rollouts.rollout import rollout
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Float, Step

SPEC = TaskSpec(horizon=5)


def first_step(n_copies: int = 3) -> Step:
    return make_env(SPEC, n_copies).reset(np.arange(n_copies, dtype=np.uint64))


def drive(observations: Float) -> Float:
    return np.sin(3 * observations[..., :2])


def test_it_is_a_policy_that_acts_as_the_function_says() -> None:
    policy, step = FunctionPolicy(drive), first_step()
    assert isinstance(policy, Policy)
    assert not policy.uses_state
    actions = policy.act(step)
    assert actions.dtype == np.float32
    assert np.array_equal(actions, np.sin(3 * step.observations[..., :2]).astype(np.float32))
    assert not policy.log_probs(step, actions).any()  # it is sure of what it does
    assert np.isneginf(policy.log_probs(step, np.float32(0.5) * actions)).all()


def test_an_episode_is_the_same_alone_and_in_a_batch() -> None:
    seeds = np.arange(3, dtype=np.uint64)
    together = list(rollout(make_env(SPEC, 3), FunctionPolicy(drive), seeds))
    alone = list(rollout(make_env(SPEC, 1), FunctionPolicy(drive), seeds))
    for ours, theirs in zip(together, alone, strict=True):
        assert np.array_equal(ours.actions, theirs.actions)
        assert not ours.log_probs.any()


@settings(deadline=None, max_examples=20)
@given(value=st.floats(-1e30, 1e30))
def test_actions_are_clipped(value: float) -> None:
    step = first_step()
    policy = FunctionPolicy(lambda seen: np.full((*seen.shape[:2], 2), value))
    actions = policy.act(step)
    assert np.array_equal(actions, np.full_like(actions, np.clip(value, -1, 1)))
    assert not FunctionPolicy(policy._function).log_probs(step, actions).any()


@pytest.mark.parametrize("shape", [(3, 2), (3, 4), (12, 2), (1, 4, 2), (3, 4, 2, 1)])
def test_what_is_no_joint_action_is_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(SchemaError, match="one action of each robot in each copy"):
        FunctionPolicy(lambda _: np.zeros(shape)).act(first_step())


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_actions_that_are_not_finite_are_refused(value: Any) -> None:
    policy = FunctionPolicy(lambda seen: np.full((*seen.shape[:2], 2), value))
    with pytest.raises(SchemaError, match="not finite"):
        policy.act(first_step())


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
