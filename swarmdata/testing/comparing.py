"""Comparisons that the contracts of algorithms share: policies, losses, states, stacked seeds."""

from collections.abc import Callable, Mapping, Sequence
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


def check_losses(losses: Mapping[str, Any], n_seeds: int) -> None:
    """Checks that there is one loss per seed, and none keeps the graph of its gradients."""
    for name, loss in losses.items():
        shape = values_of(loss).shape
        assert shape == (n_seeds,), f"loss {name!r} has shape {shape}"
        assert not getattr(loss, "requires_grad", False), f"loss {name!r} keeps the graph alive"


def check_stacking(
    trained: Callable[[Sequence[int]], Any], seeds: Sequence[int], step: Step, tolerance: float
) -> None:
    """Checks that K stacked seeds end with the policies that K separate runs end with."""
    stacked = trained(seeds)
    for position, seed in enumerate(seeds):
        policies = stacked.policy(position), trained([seed]).policy(0)
        ours, theirs = (act_on(policy, step) for policy in policies)
        gap = float(np.abs(ours - theirs).max())
        assert gap <= tolerance, f"seed {seed} differs by {gap:.1e} when it is stacked"


def check_policies(
    policy_of: Callable[[int], Policy],
    train: Callable[[], object],
    step: Step,
    *,
    are_choices: bool = False,
) -> None:
    """Checks that policies act in [-1, 1], or choose, copy by copy and again, and are snapshots."""
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
