"""Comparisons that the contracts of algorithms share: policies, states, arrays and tensors."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmdata.interfaces import Policy
from swarmdata.types import Float, Step


def act_on(policy: Policy, step: Step) -> Float:
    """Returns a policy's actions in a step in which all episodes begin."""
    policy.reset(step, np.arange(len(step.seeds)))
    return policy.act(step)


def values_of(value: Any) -> NDArray[Any]:
    """Returns the values of a tensor on any device, or of an array."""
    array: NDArray[Any] = np.asarray(value.detach().cpu() if hasattr(value, "detach") else value)
    return array


def assert_equal_states(ours: Mapping[str, Any], theirs: Mapping[str, Any], broken: str) -> None:
    """Raises an AssertionError that begins with `broken` unless two states are the same bits."""
    assert ours.keys() == theirs.keys(), f"{broken}: {sorted(ours)} against {sorted(theirs)}"
    for name, value in ours.items():
        assert np.array_equal(values_of(value), values_of(theirs[name])), f"{broken}: {name}"


def check_policies(
    policy_of: Callable[[int], Policy],
    train: Callable[[], None],
    step: Step,
    *,
    are_choices: bool = False,
) -> None:
    """Checks that policies act in [-1, 1], copy by copy, always the same, and are snapshots.

    Choices are whole numbers instead. The step has at least 2 copies.

    Raises:
        AssertionError: naming the broken promise.
    """
    policy = policy_of(0)
    actions, shape = act_on(policy, step), step.observations.shape[:2]
    assert actions.dtype == np.float32, f"actions have dtype {actions.dtype}"
    assert actions.shape[:2] == shape, f"actions have shape {actions.shape}"
    if are_choices:
        assert np.array_equal(actions, np.rint(actions)), "choices are not whole numbers"
    else:
        assert np.abs(actions).max() <= 1, "actions leave [-1, 1]"
    assert np.array_equal(act_on(policy, step), actions), "a policy acts differently the next time"
    single = act_on(policy, Step._make(field[:1] for field in step))
    assert np.array_equal(single, actions[:1]), "actions depend on the other copies"
    other = act_on(policy_of(1), step)
    assert not np.array_equal(other, actions), "seeds 0 and 1 begin with the same policy"
    train()
    assert np.array_equal(act_on(policy, step), actions), "training changed an earlier policy"
    after = act_on(policy_of(0), step)
    assert not np.array_equal(after, actions), "training did not change the policy"
