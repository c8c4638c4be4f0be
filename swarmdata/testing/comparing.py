"""What the contracts of algorithms compare: arrays or tensors, states, and a policy's actions."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmdata.interfaces import Policy
from swarmdata.types import Float, Step


def act_on(policy: Policy, step: Step) -> Float:
    """Returns what a policy does in a step in which all episodes begin."""
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
