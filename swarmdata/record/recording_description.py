"""Describes a recording before its first step: its environment, and the `Recording`."""

import re
from collections.abc import Mapping, Sequence
from functools import cache
from importlib.metadata import packages_distributions, version
from typing import Any, Literal

import numpy as np

from swarmdata.errors import SchemaError, SpecError
from swarmdata.record.agent_reader import ACTION_MASK_KEY, AgentReader
from swarmdata.record.reset_seeds import default_seed
from swarmdata.specs.origins import RecordedAgent, RecordedSpec
from swarmdata.specs.origins.recording_origin import Recording
from swarmdata.specs.recipe import MOST_POLICIES, PolicySource, Splits
from swarmdata.specs.spaces import DictSpace, space_of, width
from swarmdata.specs.task_spec import TaskSpec

StateSource = Literal["environment", "observations"]


def is_own_task(env: Any) -> bool:
    """Whether an environment is a task of this library behind PettingZoo's interface."""
    if not isinstance(getattr(env, "spec", None), TaskSpec):
        return False
    from swarmdata.envs.world.pettingzoo import ParallelWorld  # noqa: PLC0415  (compiled code)

    return isinstance(env, ParallelWorld)


def describe_environment(
    env: Any, task: str | None, options: Mapping[str, Any] | None, horizon: int | None
) -> TaskSpec | RecordedSpec:
    """The spec of an environment; a foreign one has no states yet, which only a reset shows."""
    if is_own_task(env):
        unwanted = {"task": task, "options": options, "horizon": horizon}
        if given := [name for name, value in unwanted.items() if value is not None]:
            raise SpecError(f"the spec of {env.spec.task} already has {given}; leave them out")
        spec: TaskSpec = env.spec
        return spec
    library, version = library_of(env)
    return foreign_spec(
        task or task_name(env), options, agents=describe_agents(env), library=library,
        version=version, horizon=horizon or horizon_of(env),
    )  # fmt: skip


def foreign_spec(task: str, options: Mapping[str, Any] | None, **facts: Any) -> RecordedSpec:
    """The spec of a foreign environment; without facts, states are those before the first reset."""
    states = {"state_size": 0, "state_from": "observations"}
    content = {"task": task, "options": dict(options or {}), **states, **facts}
    return RecordedSpec.parse(content, f"the recording of {task}")


def make_recording(
    spec: TaskSpec | RecordedSpec,
    id: str,
    policies: Sequence[str | PolicySource],
    metadata: Mapping[str, str] | None,
    seed: int | None,
    splits: Splits | None,
) -> Recording:
    """The recording of an environment by some policies; SpecError if they or the id do not fit."""
    sources = tuple(
        PolicySource.parse({"label": p, "name": "external"}) if isinstance(p, str) else p
        for p in policies
    )
    labels = [source.label for source in sources]
    if len(set(labels)) < len(labels) or not 1 <= len(labels) <= MOST_POLICIES:
        raise SpecError(f"policies are {labels}, expected 1 to {MOST_POLICIES} different labels")
    if not id.startswith(f"{spec.task}-"):
        raise SpecError(
            f"id {id!r} does not begin with the environment's name: expected "
            f"'{spec.task}-NAME-v0', or another `task`."
        )
    content = {
        "id": id,
        "spec": spec,
        "policies": sources,
        "seed": default_seed(id) if seed is None else seed,
        "splits": splits or Splits(),
        "source": "recorder",
        "metadata": dict(metadata or {}),
    }
    return Recording.parse(content, f"the recording {id!r}")


def state_source(
    env: Any, reader: AgentReader, wanted: Literal["auto", "environment", "observations"]
) -> tuple[StateSource, int]:
    """Where states come from right after a reset, and their size; SchemaError if they fail."""
    if wanted != "observations":
        try:
            return "environment", int(np.asarray(env.state()).size)
        except (NotImplementedError, AttributeError, TypeError) as error:
            # what only looks like ParallelEnv has no `state`; that of PettingZoo's rps is a dict
            state = getattr(getattr(env, "unwrapped", env), "state", None)
            lacks_state = isinstance(error, NotImplementedError) or not callable(state)
            if wanted == "environment" or not lacks_state:
                raise SchemaError(f"state() of {env} does not work: {error!r}") from error
    return "observations", sum(width(agent.observation) for agent in reader.agents)


def describe_agents(env: Any) -> tuple[RecordedAgent, ...]:
    """All possible agents of a `ParallelEnv`, in its order; SpecError if they cannot be stored."""
    names = getattr(env, "possible_agents", None)
    if not names:
        raise SpecError(
            f"{env} has possible_agents {names!r}, expected at least one name: a recording needs "
            "the names of all agents beforehand."
        )
    found = []
    for name in names:
        observation = space_of(env.observation_space(name), f"observation space of {name}")
        if isinstance(observation, DictSpace):
            parts = {k: part for k, part in observation.spaces.items() if k != ACTION_MASK_KEY}
            observation = DictSpace(spaces=parts)
        action = space_of(env.action_space(name), f"action space of {name}")
        content = {"name": str(name), "observation": observation, "action": action}
        found.append(RecordedAgent.parse(content))
    return tuple(found)


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
