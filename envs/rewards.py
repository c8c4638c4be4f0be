"""The reward of every task, term by term: what `world.score_steps` adds to the task's own."""

from swarmdata.envs.world import PROXIMITY
from swarmdata.interfaces import Task
from swarmdata.types import Term

CONTACT_WEIGHTS = (
    "robot_contact",
    "obstacle_contact",
    "robot_collision",
    "obstacle_collision",
    "proximity",
    "success",
    "team_share",
)
"""Fields of `rules.Rewards` that `world.score_steps` applies, in its order."""

_EVENT = "this column of `events`, of the robot in the step"

_GAP = (
    "gap: least distance, m, from the robot's surface to that of another robot, an obstacle or a "
    "wall, after the step; below 0 where they overlap. A payload is none of them"
)

_SHARED = (
    ("robot_contact", "-weight * robot_contact", _EVENT),
    ("obstacle_contact", "-weight * obstacle_contact", _EVENT),
    ("robot_collision", "-weight * robot_onsets", _EVENT),
    ("obstacle_collision", "-weight * obstacle_onsets", _EVENT),
    ("proximity", f"-weight * min(max(1 - gap / {PROXIMITY:g}, 0), 1)", _GAP),
)


def reward_terms(task: Task) -> tuple[Term, ...]:
    """All terms of a robot's reward but the team's share, which mixes their sums.

    The reward of a robot is (1 - s) times the sum of its terms plus s times the mean of these sums
    over the team, where s is `spec.rules.rewards.team_share`.
    """
    weights = task.spec.rules.rewards
    shared = tuple(Term(name, getattr(weights, name), *rest) for name, *rest in _SHARED)
    solved = f"solved: after the step, {task.solved}. Then the episode ends"
    return (
        *task.terms,
        Term("success", weights.success, "weight * [solved]", solved),
        *shared,
    )
