"""Names to code, as literal tables of "module:Name", imported only when asked for.

Users add their own with the functions `register_...`, or with entry points of the same groups.
"""

from collections.abc import Callable, Mapping
from functools import lru_cache
from numbers import Integral
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, overload

from swarmdata.errors import (
    INSTALL_HINT,
    MissingExtraError,
    SchemaError,
    SpecError,
    UnknownNameError,
    check_type,
)
from swarmdata.interfaces import Policy, Task, VecEnv
from swarmdata.registry.appearance import Appearance
from swarmdata.registry.presets import find_spec
from swarmdata.runtime.extras import require_extra
from swarmdata.runtime.own_components import ComponentTable, import_component, register
from swarmdata.specs.budget import copies_excess
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import PROXIMITY_RANGE, Term

if TYPE_CHECKING:
    from swarmdata.specs.origins import SideSpec

TASKS = ComponentTable(
    "tasks",
    {
        "coop_nav": "swarmdata.envs.coop_nav.coop_nav:CoopNav",
        "transport": "swarmdata.envs.transport.transport:Transport",
        "warehouse": "swarmdata.envs.warehouse.warehouse:Warehouse",
        "formation": "swarmdata.envs.formation.formation:Formation",
        "intersection": "swarmdata.envs.intersection.intersection:Intersection",
        "search": "swarmdata.envs.search.search:Search",
        "pursuit": "swarmdata.envs.pursuit.pursuit:Pursuit",
        "tag": "swarmdata.envs.tag.tag:Tag",
    },
)

POLICIES = ComponentTable(
    "policies",
    {
        "idle": "swarmdata.behavior_policies.simple:Idle",
        "random": "swarmdata.behavior_policies.simple:Random",
        "straight": "swarmdata.behavior_policies.simple:Straight",
        "scripted": "swarmdata.behavior_policies.scripted:Scripted",
        "scripted-alone": "swarmdata.behavior_policies.uncoordinated:Alone",
        "scripted-naive": "swarmdata.behavior_policies.uncoordinated:Naive",
        "scripted-deaf": "swarmdata.behavior_policies.uncoordinated:Deaf",
        "pursuit-greedy": "swarmdata.behavior_policies.pursuit.pursuit_controller:Greedy",
        "pursuit-lead-1": "swarmdata.behavior_policies.pursuit.pursuit_controller:LeadOne",
        "pursuit-lead-3": "swarmdata.behavior_policies.pursuit.pursuit_controller:LeadThree",
        "pursuit-lead-mixed": "swarmdata.behavior_policies.pursuit.pursuit_controller:LeadMixed",
        "tag-greedy": "swarmdata.behavior_policies.tag.tag_controller:Greedy",
        "tag-lead-3": "swarmdata.behavior_policies.tag.tag_controller:LeadThree",
        "learned": "swarmdata.behavior_policies.learned:Learned",
        "network": "swarmdata.learn.policies.network_policy:NetworkPolicy",
    },
)

CHECKPOINT_POLICIES = ("learned", "network")
"""Policies that need a checkpoint: perceptrons that are run exactly, and all other networks."""


def checkpoint_free_policies() -> set[str]:
    """Names of the registered policies that need no checkpoint."""
    return {*POLICIES} - {*CHECKPOINT_POLICIES}


SCRIPTED_CONTROLLERS = {
    "coop_nav": "swarmdata.behavior_policies.coop_nav_controller:CoopNavController",
    "transport": "swarmdata.behavior_policies.transport.transport_controller:TransportController",
    "warehouse": "swarmdata.behavior_policies.warehouse.warehouse_controller:WarehouseController",
    "formation": "swarmdata.behavior_policies.formation_controller:FormationController",
    "search": "swarmdata.behavior_policies.search.search_controller:SearchController",
    "pursuit": "swarmdata.behavior_policies.pursuit.pursuit_controller:PursuitController",
    "tag": "swarmdata.behavior_policies.tag.tag_controller:TagController",
    "intersection": (
        "swarmdata.behavior_policies.intersection.intersection_controller:IntersectionController"
    ),
}
"""Controllers of the package's tasks. A task of another package may have one as its attribute
`controller`; in others, `Scripted` drives robots to their targets."""

OFFLINE_ALGORITHMS = ComponentTable(
    "algorithms",
    {
        "bc": "swarmdata.offline_algos.bc:BC",
        "filtered_bc": "swarmdata.offline_algos.filtered_bc:FilteredBC",
        "bc_flow": "swarmdata.offline_algos.bc_flow:BCFlow",
        "bc_latent": "swarmdata.offline_algos.bc_latent:BCLatent",
        "facmac_bc": "swarmdata.offline_algos.facmac_bc:FACMACBC",
        "mac_flow": "swarmdata.offline_algos.mac_flow:MACFlow",
        "iql": "swarmdata.offline_algos.iql:IQL",
        "iql_cost": "swarmdata.offline_algos.iql_cost:IQLCost",
        "omiga": "swarmdata.offline_algos.omiga:OMIGA",
        "oryx": "swarmdata.offline_algos.oryx:Oryx",
        "maddpg_bc": "swarmdata.offline_algos.maddpg_bc:MADDPGBC",
        "matd3": "swarmdata.offline_algos.matd3:MATD3",
        "maddpg_cql": "swarmdata.offline_algos.maddpg_cql:MADDPGCQL",
        "cfcql": "swarmdata.offline_algos.cfcql:CFCQL",
        "icql_qs": "swarmdata.offline_algos.icql_qs:ICQLQS",
        "omar": "swarmdata.offline_algos.omar:OMAR",
        "vdn": "swarmdata.offline_algos.vdn:VDN",
        "qmix": "swarmdata.offline_algos.qmix:QMIX",
    },
)

DISCRETE_ALGORITHMS = ("bc", "filtered_bc", "iql", "vdn", "qmix")
"""Offline algorithms that learn choices as well as continuous actions."""

ONLINE_ALGORITHMS = ComponentTable(
    "online_algorithms",
    {
        "mappo": "swarmdata.online_algos.mappo:MAPPO",
        "maddpg": "swarmdata.online_algos.maddpg:MADDPG",
        "vdn": "swarmdata.online_algos.vdn:VDN",
        "qmix": "swarmdata.online_algos.qmix:QMIX",
        "dagger": "swarmdata.online_algos.dagger:DAgger",
    },
)


WORLDS = {
    "vector": "swarmdata.envs.world.task_env:TaskEnv",
    "pettingzoo": "swarmdata.envs.world.pettingzoo:ParallelWorld",
}
"""Interfaces of worlds: copies that are stepped together, and one as a `ParallelEnv`."""

REPLAY_BUFFERS = {"torchrl": "swarmdata.interop.torchrl.torchrl:replay_buffer"}
"""Replay buffers of other libraries over the transitions of a dataset."""


def register_task(name: str, task: Any) -> None:
    """Makes a task known by a name: specs with `rules: {task: <name>, ...}` are then of it.

    Args:
        name: of the task; it is the default of `task` in its rules.
        task: class that implements `interfaces.Task`, or "module:Name" of it. Its attribute `Rules`
            is the model of its rules, as in `swarmdata.specs.rules`.

    Raises:
        SpecError: the package has a task of this name.
    """
    register("tasks", name, task)


def register_policy(name: str, policy: Any) -> None:
    """Makes a policy known by a name: `evaluate`, `generate` and recipes then take it.

    Args:
        name: of the policy.
        policy: class that implements `interfaces.Policy` and is built as `policy(spec)`, or
            "module:Name" of it. With a keyword `noise`, `generate --noise` applies to it.

    Raises:
        SpecError: the package has a policy of this name.
    """
    register("policies", name, policy)


def register_algorithm(name: str, algorithm: Any, *, online: bool = False) -> None:
    """Makes an algorithm known by a name: `train`, `study` and all others then take it.

    Args:
        name: of the algorithm.
        algorithm: class that implements `interfaces.Algorithm`, or with `online`
            `interfaces.OnlineAlgorithm`; or "module:Name" of it.
        online: whether it learns in worlds, not from data.

    Raises:
        SpecError: the package has an algorithm of this name.
    """
    register("online_algorithms" if online else "algorithms", name, algorithm)


def resolve(kind: str, table: Mapping[str, Any], name: str) -> Any:
    """Imports what `table` names."""
    if name not in table:
        raise UnknownNameError(kind, name, table, INSTALL_HINT)
    try:
        return import_component(table[name])
    except ModuleNotFoundError as error:
        if error.name != "torch":
            raise
        raise MissingExtraError("torch", "torch", f"{kind} {name!r}") from None


def make_task(spec: TaskSpec | Path | str) -> Task:
    """Builds the task that a spec describes, given as `make_env` takes it."""
    spec = find_spec(spec)
    build: Callable[[TaskSpec], Task] = resolve("task", TASKS, spec.task)
    return build(spec)


def appearance_of(spec: TaskSpec) -> Appearance:
    """How the task of a spec is drawn; the default where it does not say."""
    return _appearance(spec, resolve("task", TASKS, spec.task))


@lru_cache(maxsize=64)
def _appearance(spec: TaskSpec, kind: Any) -> Appearance:
    find: Callable[[TaskSpec], Appearance] | None = getattr(kind, "appearance", None)
    return Appearance(bodies=kind(spec).movables) if find is None else find(spec)


_GAP_MEANING = (
    "gap: smallest distance, m, after the step from the robot's surface to that of another robot, "
    "an obstacle or a wall; negative where they overlap. Payloads do not count"
)

_CONTACT_TERMS = (
    ("robot_contact", "robot_contact"),
    ("obstacle_contact", "obstacle_contact"),
    ("robot_collision", "robot_onsets"),
    ("obstacle_collision", "obstacle_onsets"),
)
"""The weight of each contact term, and the column of `events` that it multiplies."""


def reward_terms(task: Task) -> tuple[Term, ...]:
    """Returns all terms of a robot's reward, in the order of the columns of `reward_terms`.

    `numerics.weighted_terms` defines the reward that follows from them.
    """
    weights = task.spec.rules.rewards
    contacts = tuple(
        Term(
            name,
            getattr(weights, name),
            -1,
            event,
            f"{event}: the column of `events` with this name, of the robot in this step",
        )
        for name, event in _CONTACT_TERMS
    )
    near = f"min(max(1 - gap / {PROXIMITY_RANGE:g}, 0), 1)"
    success, solved = "[solved]", f"solved: after the step, {task.solved}. Then the episode ends"
    if len(task.spec.sides) > 1:
        success, first = "[won]", task.spec.sides[0].name
        solved = (
            f"won: of the {first}, after the step, {task.solved}, and the episode ends; of the "
            "others, the step is the last of the horizon, and this does not hold"
        )
    return (
        *task.terms,
        Term("success", weights.success, 1, success, solved),
        *contacts,
        Term("proximity", weights.proximity, -1, near, _GAP_MEANING),
    )


@overload
def make_env(
    spec: TaskSpec | Path | str, n_copies: int = 1, *, n_threads: int = 1,
    api: Literal["vector"] = "vector",
) -> VecEnv: ...  # fmt: skip
@overload
def make_env(
    spec: TaskSpec | Path | str, n_copies: int = 1, *, api: Literal["pettingzoo"],
    render_mode: str | None = None,
) -> Any: ...  # fmt: skip
def make_env(
    spec: TaskSpec | Path | str, n_copies: int = 1, *, n_threads: int = 1, api: str = "vector",
    render_mode: str | None = None,
) -> Any:  # fmt: skip
    """Builds the world of a task.

    Args:
        spec: the task; or a preset's name, or a spec file.
        n_copies: copies stepped together, E; a PettingZoo environment has one.
        n_threads: threads that step them, each its share; at most E are started. The bits do not
            depend on it. It pays from about a hundred copies on: a step of all copies has to be
            long against the 40 us that the threads need to meet.
        api: `vector` for a `VecEnv`, `pettingzoo` for a `ParallelEnv`, which needs PettingZoo. Both
            have `close()`.
        render_mode: of a PettingZoo environment: `rgb_array` for pictures [H, W, 3] from `render`.

    Raises:
        SpecError: the copies would not fit into memory, the spec contradicts itself, or there is no
            such render mode.
        UnknownNameError: another interface.
        SchemaError: `n_threads` is not positive, `n_copies` no whole number, a PettingZoo
            environment is to have several copies or threads, or another one a render mode.
    """
    check_type("n_copies", n_copies, Integral, "a whole number")
    if n_threads < 1:
        raise SchemaError(f"n_threads is {n_threads}, expected at least 1")
    kind: Callable[..., Any] = resolve("api", WORLDS, api)
    spec = find_spec(spec)
    if api == "pettingzoo":
        if n_copies != 1 or n_threads != 1:
            raise SchemaError(
                "a PettingZoo environment has 1 copy and 1 thread, got "
                f"n_copies={n_copies} and n_threads={n_threads}"
            )
        return kind(spec, render_mode)
    if render_mode is not None:
        raise SchemaError(f"got render_mode {render_mode!r}, which is of api pettingzoo")
    if problem := copies_excess(spec, n_copies):
        raise SpecError(problem)
    further = [make_task(spec) for _ in range(min(n_threads, n_copies) - 1)]
    return kind(make_task(spec), n_copies, further_tasks=further)


def policy_class(name: str, spec: "TaskSpec | SideSpec") -> Callable[..., Policy]:
    """Returns the class of the named policy in the task that `spec` describes."""
    if name == "network":
        require_extra("torch", "torch", "running a network that is not run exactly")
    build: Callable[..., Policy] = resolve("policy", POLICIES, name)
    if name != "scripted":
        return build
    if spec.task in SCRIPTED_CONTROLLERS:
        return resolve("controller", SCRIPTED_CONTROLLERS, spec.task)
    return getattr(resolve("task", TASKS, spec.task), "controller", build)


def make_policy(name: str, spec: "TaskSpec | SideSpec", **options: Any) -> Policy:
    """Builds the named policy for the task that `spec` describes; for a side of it, a network."""
    return policy_class(name, spec)(spec, **options)
