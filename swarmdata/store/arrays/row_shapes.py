"""The shape of one row of every array, as the spec of a dataset determines it."""

from collections.abc import Mapping
from functools import lru_cache
from types import MappingProxyType

from swarmdata.specs.origins import Origin
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import EVENTS

Shape = tuple[int | None, ...]  # None: any size

MAY_BE_EMPTY = ("log_probs", "events", "sent", "delivered", "ages", "episodes/layouts")
"""Arrays without columns, or rows, where a recording does not have them."""


def row_shapes(origin: Origin, *, widths: bool) -> Mapping[str, Shape]:
    """Shapes without the first axis, by the name of the array; `widths`: see `task_row_shapes`."""
    spec = origin.spec
    if spec.world is not None and origin.missing is None:
        return task_row_shapes(spec.world, widths=widths)
    known = _of_any(spec.n_agents, spec.action_size)
    if origin.missing is not None:  # the task of another package
        return known
    return known | {
        "observations": (spec.n_agents, spec.observation_size),
        "states": (spec.state_size,),
        "events": (spec.n_agents, 0),
        "episodes/layouts": (0, 8),
    }


@lru_cache(maxsize=64)
def task_row_shapes(spec: TaskSpec, *, widths: bool = True) -> Mapping[str, Shape]:
    """`row_shapes` of our tasks.

    `widths` adds those of observations, states, messages and layouts, which take the task's code,
    which is compiled.
    """
    n_terms = len(type(spec.rules.rewards).model_fields) - 1  # every weight but team_share has one
    known = _of_any(spec.n_agents, spec.action_size) | {
        "events": (spec.n_agents, len(EVENTS)),
        "reward_terms": (spec.n_agents, n_terms),
    }
    return MappingProxyType(known | _of_task(spec) if widths else known)


def _of_any(n_agents: int, action_size: int) -> dict[str, Shape]:
    """What follows from the team alone."""
    return {
        "observations": (n_agents, None),
        "sent": (n_agents, None),
        "actions": (n_agents, action_size),
        "log_probs": (n_agents,),
        "rewards": (n_agents,),
        "reward_terms": (n_agents, None),
        "alive": (n_agents,),
        "action_masks": (n_agents, None),
        "agent_terminations": (n_agents,),
        "agent_truncations": (n_agents,),
    }


def _of_task(spec: TaskSpec) -> dict[str, Shape]:
    from swarmdata.perception.observer import Observer  # noqa: PLC0415  (numba, which readers do without)
    from swarmdata.registry.components import make_task  # noqa: PLC0415  (the same)
    from swarmdata.specs.state_layout import state_size  # noqa: PLC0415  (the same)

    task, n = make_task(spec), spec.n_agents
    observations, sent, delivered, ages = Observer(task, 1).allocate((), n)
    return {
        "observations": observations.shape,
        "sent": sent.shape,
        "delivered": delivered.shape,
        "ages": ages.shape,
        "states": (state_size(n, len(task.movables), len(task.extras)),),
        "episodes/layouts": (len(task.kinds), 8),
    }
