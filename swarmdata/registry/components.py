"""Names to code, as literal tables of "module:Name", imported only when asked for."""

from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any

from swarmdata.errors import SpecError, UnknownNameError
from swarmdata.interfaces import Policy, Task, VecEnv
from swarmdata.registry.replaced_worlds import check_world
from swarmdata.specs.budget import copies_excess
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Term

TASKS = {
    "coop_nav": "swarmdata.envs.coop_nav.coop_nav:CoopNav",
    "transport": "swarmdata.envs.transport.transport:Transport",
    "warehouse": "swarmdata.envs.warehouse.warehouse:Warehouse",
    "formation": "swarmdata.envs.formation.formation:Formation",
}

POLICIES = {
    "idle": "swarmdata.behavior_policies.simple:Idle",
    "random": "swarmdata.behavior_policies.simple:Random",
    "straight": "swarmdata.behavior_policies.simple:Straight",
    "scripted": "swarmdata.behavior_policies.scripted:Scripted",
    "learned": "swarmdata.behavior_policies.learned:Learned",
}

SCRIPTED_CONTROLLERS = {
    "coop_nav": "swarmdata.behavior_policies.coop_nav_controller:CoopNavController",
    "transport": "swarmdata.behavior_policies.transport.transport_controller:TransportController",
    "warehouse": "swarmdata.behavior_policies.warehouse.warehouse_controller:WarehouseController",
    "formation": "swarmdata.behavior_policies.formation_controller:FormationController",
}
"""Controllers of the tasks that need one of their own; `Scripted` drives robots to their targets
in the others."""

OFFLINE_ALGORITHMS = {
    "bc": "swarmdata.offline_algos.bc:BC",
    "filtered_bc": "swarmdata.offline_algos.filtered_bc:FilteredBC",
    "bc_flow": "swarmdata.offline_algos.bc_flow:BCFlow",
    "bc_latent": "swarmdata.offline_algos.bc_latent:BCLatent",
    "facmac_bc": "swarmdata.offline_algos.facmac_bc:FACMACBC",
    "mac_flow": "swarmdata.offline_algos.mac_flow:MACFlow",
    "iql": "swarmdata.offline_algos.iql:IQL",
    "omiga": "swarmdata.offline_algos.omiga:OMIGA",
    "maddpg_bc": "swarmdata.offline_algos.maddpg_bc:MADDPGBC",
    "maddpg_cql": "swarmdata.offline_algos.maddpg_cql:MADDPGCQL",
    "cfcql": "swarmdata.offline_algos.cfcql:CFCQL",
    "icql_qs": "swarmdata.offline_algos.icql_qs:ICQLQS",
    "omar": "swarmdata.offline_algos.omar:OMAR",
    "vdn": "swarmdata.offline_algos.vdn:VDN",
    "qmix": "swarmdata.offline_algos.qmix:QMIX",
}

DISCRETE_ALGORITHMS = ("vdn", "qmix")
"""Offline algorithms that learn choices as well as continuous actions."""

ONLINE_ALGORITHMS = {
    "mappo": "swarmdata.online_algos.mappo:MAPPO",
    "maddpg": "swarmdata.online_algos.maddpg:MADDPG",
    "vdn": "swarmdata.online_algos.vdn:VDN",
    "qmix": "swarmdata.online_algos.qmix:QMIX",
}


def resolve(kind: str, table: Mapping[str, str], name: str) -> Any:
    """Imports what `table` names.

    Raises:
        UnknownNameError: with the nearest known name.
    """
    if name not in table:
        raise UnknownNameError(kind, name, table)
    module, attribute = table[name].split(":")
    return getattr(import_module(module), attribute)


def make_task(spec: TaskSpec) -> Task:
    """Builds the task that `spec` describes."""
    build: Callable[[TaskSpec], Task] = resolve("task", TASKS, spec.task)
    return build(spec)


def reward_terms(task: Task) -> tuple[Term, ...]:
    """Every term of a robot's reward in `task`: its own, and those that all tasks share."""
    terms: tuple[Term, ...] = import_module("swarmdata.envs.world.rewards").reward_terms(task)
    return terms


def make_env(spec: TaskSpec, n_copies: int = 1) -> VecEnv:
    """Builds `n_copies` copies of the task that `spec` describes.

    Raises:
        SpecError: they would not fit into memory, the spec contradicts itself, or it is of an older
            version of the world.
    """
    check_world(spec)
    if problem := copies_excess(spec, n_copies):
        raise SpecError(problem)
    build: Callable[[Task, int], VecEnv] = import_module("swarmdata.envs.world.task_env").TaskEnv
    return build(make_task(spec), n_copies)


def make_policy(name: str, spec: TaskSpec, **options: Any) -> Policy:
    """Builds the named policy for the task that `spec` describes."""
    table = {**POLICIES, "scripted": SCRIPTED_CONTROLLERS.get(spec.task, POLICIES["scripted"])}
    build: Callable[..., Policy] = resolve("policy", table, name)
    return build(spec, **options)
