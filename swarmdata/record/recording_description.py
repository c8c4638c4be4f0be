"""Describes a recording before its first step, as a `Recording`."""

from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np

from swarmdata.errors import SchemaError, SpecError
from swarmdata.record.agent_reader import AgentReader
from swarmdata.record.foreign_environment import describe_agents, horizon_of, library_of, task_name
from swarmdata.specs.origins import RecordedAgent, RecordedSpec
from swarmdata.specs.origins.recording_origin import Recording
from swarmdata.specs.recipe import MOST_POLICIES, PolicySource, Splits
from swarmdata.specs.spaces import width
from swarmdata.specs.task_spec import TaskSpec

StateSource = Literal["environment", "observations"]


def is_own_task(env: Any) -> bool:
    """Whether an environment is a task of this library behind PettingZoo's interface."""
    if not isinstance(getattr(env, "spec", None), TaskSpec):
        return False
    from swarmdata.envs.world.pettingzoo import ParallelWorld  # noqa: PLC0415  (compiled code)

    return isinstance(env, ParallelWorld)


def describe_recording(
    env: Any,
    id: str,
    policies: Sequence[str | PolicySource],
    task: str | None,
    options: Mapping[str, Any] | None,
    horizon: int | None,
    metadata: Mapping[str, str] | None,
    seed: int,
    splits: Splits,
) -> Recording:
    """Returns the recording; a foreign spec has no states yet, which only a reset shows.

    Raises:
        SpecError: the environment, the id or the metadata cannot be stored.
    """
    if is_own_task(env):
        unwanted = {"task": task, "options": options, "horizon": horizon}
        if given := [name for name, value in unwanted.items() if value is not None]:
            raise SpecError(f"the spec of {env.spec.task} already has {given}; leave them out")
        spec: TaskSpec | RecordedSpec = env.spec
    else:
        library, version = library_of(env)
        spec = foreign_spec(
            describe_agents(env), task or task_name(env), library, version, options,
            horizon or horizon_of(env),
        )  # fmt: skip
    return make_recording(spec, id, policies, metadata, seed, splits)


def foreign_spec(
    agents: Sequence[RecordedAgent],
    task: str,
    library: str,
    version: str,
    options: Mapping[str, Any] | None,
    horizon: int | None,
) -> RecordedSpec:
    """The spec of a foreign environment, with states from observations whose size is still 0."""
    content = {
        "task": task,
        "library": library,
        "version": version,
        "options": dict(options or {}),
        "agents": tuple(agents),
        "state_size": 0,
        "state_from": "observations",
        "horizon": horizon,
    }
    return RecordedSpec.parse(content, f"the recording of {task}")


def make_recording(
    spec: TaskSpec | RecordedSpec,
    id: str,
    policies: Sequence[str | PolicySource],
    metadata: Mapping[str, str] | None,
    seed: int,
    splits: Splits,
) -> Recording:
    """Returns the recording of an environment by some policies.

    Raises:
        SpecError: the id does not begin with the environment's name, or two policies share a label.
    """
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
        "seed": seed,
        "splits": splits,
        "source": "recorder",
        "metadata": dict(metadata or {}),
    }
    return Recording.parse(content, f"the recording {id!r}")


def state_source(
    env: Any,
    reader: AgentReader,
    wanted: Literal["auto", "environment", "observations"],
) -> tuple[StateSource, int]:
    """Where states come from, and their size; to be called right after a reset.

    Raises:
        SchemaError: `state()` is wanted or exists, and fails.
    """
    if wanted != "observations":
        try:
            return "environment", int(np.asarray(env.state()).size)
        except (NotImplementedError, AttributeError) as error:
            # AttributeError: a class that only looks like ParallelEnv and has no `state`
            lacks_state = isinstance(error, NotImplementedError) or not hasattr(env, "state")
            if wanted == "environment" or not lacks_state:
                raise SchemaError(f"state() of {env} does not work: {error!r}") from error
    return "observations", sum(width(agent.observation) for agent in reader.agents)
