"""The reward of every task, term by term: its own terms, then those that `score_steps` writes."""

from swarmdata.envs.world.world import PROXIMITY_RANGE
from swarmdata.interfaces import Task
from swarmdata.types import Term

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
    solved = f"solved: after the step, {task.solved}. Then the episode ends"
    return (
        *task.terms,
        Term("success", weights.success, 1, "[solved]", solved),
        *contacts,
        Term("proximity", weights.proximity, -1, near, _GAP_MEANING),
    )
