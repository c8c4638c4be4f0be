"""The shape of one row of every array, as the spec of a dataset determines it."""

import math
from collections.abc import Mapping

from swarmdata.specs.origins import Origin, Spec
from swarmdata.specs.state_layout import state_size
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import EVENTS

Shape = tuple[int | None, ...]
"""None: any size."""

MAY_BE_EMPTY = ("log_probs", "events", "sent", "delivered", "ages", "episodes/layouts")
"""Arrays without columns, or rows, where a recording does not have them."""


def row_shapes(spec: Spec, *, widths: bool = True) -> dict[str, Shape]:
    """Shapes without the first axis, by the name of the array.

    Args:
        spec: of the dataset.
        widths: whether the widths of observations, states, messages and layouts of a task shall be
            known as well. They take the task's code, which is compiled.
    """
    known = _of_any(spec.n_agents, spec.action_size)
    if spec.world is None:
        return known | _of_recording(spec)
    known["events"] = (spec.n_agents, len(EVENTS))
    return known | _of_task(spec.world) if widths else known


def contradictions(
    origin: Origin, shapes: Mapping[str, tuple[int, ...]], *, widths: bool = True
) -> tuple[str, ...]:
    """In what the shapes of a dataset's arrays contradict its spec.

    Args:
        origin: of the dataset. What is not a recipe may lack some arrays.
        shapes: whole shapes by the name of the array.
        widths: as of `row_shapes`.
    """
    problems = []
    for name, expected in row_shapes(origin.spec, widths=widths).items():
        if name not in shapes:
            continue
        got = shapes[name][1:]
        is_absent = origin.recipe is None and name in MAY_BE_EMPTY and not math.prod(got)
        if not is_absent and not _fits(got, expected):
            shown = ", ".join("any" if size is None else str(size) for size in expected)
            problems.append(f"{name} has rows of shape {list(got)}, expected [{shown}] by the spec")
    return tuple(problems)


def _fits(got: tuple[int, ...], expected: Shape) -> bool:
    pairs = zip(got, expected, strict=False)
    return len(got) == len(expected) and all(size in (None, found) for found, size in pairs)


def _of_any(n_agents: int, action_size: int) -> dict[str, Shape]:
    """What follows from the team alone."""
    return {
        "observations": (n_agents, None),
        "sent": (n_agents, None),
        "actions": (n_agents, action_size),
        "log_probs": (n_agents,),
        "rewards": (n_agents,),
        "alive": (n_agents,),
        "action_masks": (n_agents, None),
        "agent_terminations": (n_agents,),
        "agent_truncations": (n_agents,),
    }


def _of_task(spec: TaskSpec) -> dict[str, Shape]:
    from swarmdata.perception.observer import Observer  # noqa: PLC0415  (numba, which readers do without)
    from swarmdata.registry.components import make_task  # noqa: PLC0415  (the same)

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


def _of_recording(spec: Spec) -> dict[str, Shape]:
    return {
        "observations": (spec.n_agents, spec.observation_size),
        "states": (spec.state_size,),
        "events": (spec.n_agents, 0),
        "episodes/layouts": (0, 8),
    }
