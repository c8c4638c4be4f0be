"""What is known of a recording before its first step, as a `Recording`."""

from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np

from swarmdata.errors import SchemaError, SpecError
from swarmdata.record.foreign_environment import agents_of, horizon_of, library_of, task_name
from swarmdata.record.row_reader import Reader
from swarmdata.specs.origins import RecordedAgent, RecordedSpec, Recording
from swarmdata.specs.recipe import MOST_POLICIES, PolicySource, Splits
from swarmdata.specs.spaces import width
from swarmdata.specs.task_spec import TaskSpec

StateSource = Literal["environment", "observations"]


def is_ours(env: Any) -> bool:
    """Whether an environment is a task of this library behind PettingZoo's interface."""
    if not isinstance(getattr(env, "spec", None), TaskSpec):
        return False
    from swarmdata.envs.world.pettingzoo import ParallelWorld  # noqa: PLC0415  (compiled code)

    return isinstance(env, ParallelWorld)


def describe(
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
    """Returns the recording as far as it is known; a foreign spec lacks its state.

    Raises:
        SpecError: the environment, the id or the metadata cannot be stored.
    """
    if is_ours(env):
        unwanted = {"task": task, "options": options, "horizon": horizon}
        if given := [name for name, value in unwanted.items() if value is not None]:
            raise SpecError(f"{given} are in the spec of {env.spec.task}; leave them out")
        spec: TaskSpec | RecordedSpec = env.spec
    else:
        library, version = library_of(env)
        spec = foreign_spec(
            agents_of(env), task or task_name(env), library, version, options,
            horizon or horizon_of(env),
        )  # fmt: skip
    return recording_of(spec, id, policies, metadata, seed, splits)


def foreign_spec(
    agents: Sequence[RecordedAgent],
    task: str,
    library: str,
    version: str,
    options: Mapping[str, Any] | None,
    horizon: int | None,
) -> RecordedSpec:
    """The spec of a foreign environment with states from observations, of size 0 as yet."""
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


def recording_of(
    spec: TaskSpec | RecordedSpec,
    id: str,
    policies: Sequence[str | PolicySource],
    metadata: Mapping[str, str] | None,
    seed: int,
    splits: Splits,
) -> Recording:
    """Puts a recording together.

    Raises:
        SpecError: the id is not one of this environment, or two policies have one label.
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
            f"id {id!r} does not begin with its environment's name: expected "
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
    reader: Reader,
    wanted: Literal["auto", "environment", "observations"],
) -> tuple[StateSource, int]:
    """Where states come from, and their size; asked right after a reset.

    Raises:
        SchemaError: states of the environment are wanted and it has none.
    """
    if wanted != "observations":
        try:
            return "environment", int(np.asarray(env.state()).size)
        except (NotImplementedError, AttributeError) as error:
            # AttributeError: a class that only looks like ParallelEnv and has no `state`
            if wanted == "environment" or not _lacks_state(env, error):
                raise SchemaError(f"state() of {env} does not work: {error!r}") from error
    return "observations", sum(width(agent.observation) for agent in reader.agents)


def _lacks_state(env: Any, error: Exception) -> bool:
    return isinstance(error, NotImplementedError) or not hasattr(env, "state")
