"""A foreign environment as frozen data: its gymnasium spaces, its name, its library."""

import re
from collections.abc import Mapping
from functools import cache
from importlib.metadata import packages_distributions, version
from typing import Any

import numpy as np

from swarmdata.errors import SpecError
from swarmdata.specs.gymnasium_spaces import space_of
from swarmdata.specs.origins import RecordedAgent
from swarmdata.specs.spaces import DictSpace, Space

MASK = "action_mask"
"""Key of a mask in an agent's info or observation (PettingZoo, "Action Masking")."""


def without_mask(space: Space) -> Space:
    """The space of an observation without the mask that it may carry."""
    if isinstance(space, DictSpace) and MASK in space.spaces:
        return DictSpace(spaces={k: s for k, s in space.spaces.items() if k != MASK})
    return space


def agents_of(env: Any) -> tuple[RecordedAgent, ...]:
    """Describes all possible agents of a `ParallelEnv`, in its order.

    Raises:
        SpecError: it has none, or a space that cannot be stored.
    """
    names = getattr(env, "possible_agents", None)
    if not names:
        raise SpecError(
            f"{env} has possible_agents {names!r}, expected at least one name: a recording needs "
            "to know all agents beforehand."
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
    """Name of an environment as part of an id: `metadata["name"]`, else of its class, cleaned."""
    metadata = getattr(env, "metadata", None) or {}
    name = metadata.get("name") if isinstance(metadata, Mapping) else None
    return clean_name(str(name or type(getattr(env, "unwrapped", env)).__name__))


def clean_name(name: str) -> str:
    """Lower case with underscores, such as `simple_spread_v3`."""
    return re.sub(r"[^a-z0-9_]+", "_", name.lower()).strip("_") or "unnamed"


def library_of(env: Any) -> tuple[str, str]:
    """The library that has an environment, and its version; empty where it is no installed one."""
    module = type(getattr(env, "unwrapped", env)).__module__.partition(".")[0]
    if module in ("", "__main__", "builtins"):
        return "", ""
    return module, library_version(module)


def library_version(module: str) -> str:
    """Version of the installed distribution that has a module, empty where there is none."""
    distributions = _distributions().get(module, [])
    return version(distributions[0]) if distributions else ""


@cache
def _distributions() -> Mapping[str, list[str]]:
    return packages_distributions()


def horizon_of(env: Any) -> int | None:
    """Most steps of an episode, where the environment has the usual attribute for it."""
    value: Any = getattr(getattr(env, "unwrapped", env), "max_cycles", None)
    is_count = isinstance(value, int | np.integer) and not isinstance(value, bool) and value > 0
    return int(value) if is_count else None
