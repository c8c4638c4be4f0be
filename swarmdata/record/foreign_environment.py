"""Describes a foreign environment: its spaces, name, library and horizon."""

import re
from collections.abc import Mapping
from functools import cache
from importlib.metadata import packages_distributions, version
from typing import Any

import numpy as np

from swarmdata.errors import SpecError
from swarmdata.specs.origins import RecordedAgent
from swarmdata.specs.spaces import DictSpace, Space, space_of

ACTION_MASK_KEY = "action_mask"
"""Key of the action mask in an agent's info or observation (PettingZoo, "Action Masking")."""


def without_mask(space: Space) -> Space:
    """An observation space without its action mask, if it has one."""
    if isinstance(space, DictSpace) and ACTION_MASK_KEY in space.spaces:
        return DictSpace(spaces={k: s for k, s in space.spaces.items() if k != ACTION_MASK_KEY})
    return space


def describe_agents(env: Any) -> tuple[RecordedAgent, ...]:
    """Describes all possible agents of a `ParallelEnv`, in its order.

    Raises:
        SpecError: there are none, or a space cannot be stored.
    """
    names = getattr(env, "possible_agents", None)
    if not names:
        raise SpecError(
            f"{env} has possible_agents {names!r}, expected at least one name: a recording needs "
            "the names of all agents beforehand."
        )
    return tuple(
        RecordedAgent.parse(
            {
                "name": str(name),
                "observation": without_mask(
                    space_of(env.observation_space(name), f"observation space of {name}")
                ),
                "action": space_of(env.action_space(name), f"action space of {name}"),
            }
        )
        for name in names
    )


def task_name(env: Any) -> str:
    """An environment's name for an id: `metadata["name"]`, else that of its class, cleaned."""
    metadata = getattr(env, "metadata", None) or {}
    name = metadata.get("name") if isinstance(metadata, Mapping) else None
    return clean_name(str(name or type(getattr(env, "unwrapped", env)).__name__))


def clean_name(name: str) -> str:
    """A name in lower case with underscores, such as `simple_spread_v3`."""
    return re.sub(r"[^a-z0-9_]+", "_", name.lower()).strip("_") or "unnamed"


def library_of(env: Any) -> tuple[str, str]:
    """Library and version of an environment; both empty if it is of no installed library."""
    module = type(getattr(env, "unwrapped", env)).__module__.partition(".")[0]
    if module in ("", "__main__", "builtins"):
        return "", ""
    return module, library_version(module)


@cache  # listing all distributions is slow
def library_version(module: str) -> str:
    """Version of the installed distribution of a module; empty if there is none."""
    distributions = packages_distributions().get(module, [])
    return version(distributions[0]) if distributions else ""


def horizon_of(env: Any) -> int | None:
    """Most steps of an episode, if the environment says so: `max_cycles`, or Gymnasium's spec."""
    value: Any = getattr(getattr(env, "unwrapped", env), "max_cycles", None)
    if value is None:
        value = getattr(getattr(env, "spec", None), "max_episode_steps", None)
    is_count = isinstance(value, int | np.integer) and not isinstance(value, bool) and value > 0
    return int(value) if is_count else None
