"""The metrics of an episode, and its score relative to the references of a task."""

from collections.abc import Mapping
from functools import cache
from types import MappingProxyType

import numpy as np

from swarmdata.interfaces import Task
from swarmdata.registry.components import TASKS, resolve
from swarmdata.rollouts.side_policy import episode_of_side
from swarmdata.specs.origins import SideSpec
from swarmdata.specs.rules import rules_model
from swarmdata.specs.state_layout import Y, robots_of
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import EVENTS, Double, Episode, Int, Metric

_ROBOT_CONTACT, _OBSTACLE_CONTACT, _ROBOT_ONSETS, _OBSTACLE_ONSETS = range(len(EVENTS))

EPISODE_METRICS: Mapping[str, Metric] = MappingProxyType(
    {
        "return": Metric("return", "", "higher", "sum over time of the mean reward over robots"),
        "success": Metric("success", "", "higher", "1 if the task was solved, else 0"),
        "clean_success": Metric(
            "clean success", "", "higher", "1 if the task was solved and nothing was ever touched"
        ),
        "time_to_goal": Metric("time to goal", "s", "lower", "duration; NaN unless solved"),
        "length": Metric("length", "steps", "neither", "joint steps"),
        "robot_collisions": Metric(
            "robot collisions", "", "lower", "contacts that began between robots, each pair once"
        ),
        "obstacle_collisions": Metric(
            "obstacle collisions", "", "lower", "contacts that began with obstacles or walls"
        ),
        "contact_steps": Metric(
            "contact steps", "robot-steps", "lower", "robot-steps in contact with anything"
        ),
        "min_separation": Metric(
            "smallest gap",
            "m",
            "higher",
            "smallest gap between two robots' surfaces in any state; negative if they overlap; "
            "NaN for a single robot",
        ),
        "path_length": Metric("path length", "m", "lower", "way travelled, mean over robots"),
    }
)
"""Every per-episode metric that all tasks have, by name, in the order of `episode_metrics`."""


def metrics_of(task: str) -> Mapping[str, Metric]:
    """Returns every per-episode metric of a task: those of all tasks, then its own.

    Raises:
        UnknownNameError: no task has this name.
    """
    own = resolve("task", TASKS, task).metrics
    found, names = dict(EPISODE_METRICS), rules_model(task).side_names
    for name in names if len(names) > 1 else ():
        meaning = "sum over time of the mean reward over the robots of this side"
        found[f"{name}_return"] = Metric(f"return of {name}", "", "higher", meaning)
        meaning = "1 if this side succeeded, else 0"
        found[f"{name}_success"] = Metric(f"success of {name}", "", "higher", meaning)
    return {**found, **own}


def _of_sides(episode: Episode, spec: TaskSpec) -> dict[str, float]:
    """Return and success of each side, if there are several."""
    found: dict[str, float] = {}
    for side in spec.sides if len(spec.sides) > 1 else ():
        own = episode_of_side(episode, side)
        found[f"{side.name}_return"] = own.team_return
        found[f"{side.name}_success"] = float(own.success)
    return found


def episode_metrics(episode: Episode, task: Task) -> dict[str, float]:
    """Returns one value for each metric in `metrics_of` the task.

    Raises:
        SchemaError: the episode's states do not fit this task's team.
    """
    spec = task.spec
    positions = robots_of(episode.states, spec.n_agents)[..., : Y + 1].astype(np.float64)
    events = episode.events
    moves = positions[1:] - positions[:-1]
    lengths = np.sqrt(moves[..., 0] * moves[..., 0] + moves[..., 1] * moves[..., 1])
    touched = events[..., _ROBOT_CONTACT] | events[..., _OBSTACLE_CONTACT]  # [T, N]
    totals = events.sum(axis=(0, 1), dtype=np.int64)
    return {
        "return": episode.team_return,
        "success": float(episode.success),
        "clean_success": float(episode.success and not events.any()),
        "time_to_goal": len(episode) * spec.control_dt if episode.success else float("nan"),
        "length": float(len(episode)),
        "robot_collisions": float(totals[_ROBOT_ONSETS]) / 2,  # both robots count the onset
        "obstacle_collisions": float(totals[_OBSTACLE_ONSETS]),
        "contact_steps": float(np.count_nonzero(touched)),
        "min_separation": _min_separation(positions, spec),
        "path_length": float(lengths.sum(axis=0).mean()),
        **_of_sides(episode, spec),
        **task.episode_metrics(episode),
    }


def metrics_of_side(episode: Episode, spec: SideSpec) -> dict[str, float]:
    """The metrics that differ for a side of an episode: its own return and success.

    Its success is clean if its own robots touched nothing.
    """
    own = episode_of_side(episode, spec.agents)
    return {
        "return": own.team_return,
        "success": float(own.success),
        "clean_success": float(own.success and not own.events.any()),
        "time_to_goal": len(own) * spec.time_step if own.success else float("nan"),
    }


def _min_separation(positions: Double, spec: TaskSpec) -> float:
    """Smallest surface-to-surface gap between two robots over all states, m."""
    if spec.n_agents == 1:
        return float("nan")
    first, second = _pairs(spec.n_agents)
    radii = np.array([robot.radius for robot in spec.robots])
    apart = positions.take(first, axis=1) - positions.take(second, axis=1)  # [T+1, pairs, 2]
    nearest = np.sqrt((apart[..., 0] * apart[..., 0] + apart[..., 1] * apart[..., 1]).min(axis=0))
    return float((nearest - (radii[first] + radii[second])).min())


@cache
def _pairs(n_agents: int) -> tuple[Int, Int]:
    return np.triu_indices(n_agents, k=1)


SOLVED_TIME = "time when solved"
"""What means of `time_to_goal` over solved episodes alone are called, as in measured references."""


def censored_times(times: Double, limit: float) -> Double:
    """Returns min(time, limit) of times to goal, s, [E]; NaN, never reached, counts as `limit`.

    Their mean is the restricted mean survival time, the area under the Kaplan-Meier curve up to
    `limit` (Royston and Parmar, BMC Medical Research Methodology 13:152, 2013).
    """
    return np.asarray(np.fmin(times, limit))  # fmin ignores NaN
