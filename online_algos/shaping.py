"""The rewards that MAPPO trains on: the task's, with costs that train careful drivers."""

import numpy as np

from swarmdata.online_algos.conventions import on_the_wrong_side
from swarmdata.rules import Rewards
from swarmdata.types import Float, Step


def shaped_rewards(
    step: Step, weights: Rewards, *, contact_cost: float, keep_right: float, team_share: float
) -> Float:
    """Returns each robot's reward to train on, float32 [E, N].

    Args:
        step: what was reached, with the task's rewards and the contacts on the way.
        weights: the task's, from which the extra costs of contacts and collisions are taken.
        contact_cost: how much of each of them is added, 0 or more.
        keep_right: cost of each oncoming robot on the right, see `on_the_wrong_side`.
        team_share: part of each reward that is the team's mean, in [0, 1].
    """
    costs = np.array(
        [
            weights.robot_contact, weights.obstacle_contact,
            weights.robot_collision, weights.obstacle_collision,
        ],
        np.float32,
    )  # fmt: skip
    rewards = step.rewards - contact_cost * (step.events @ costs)
    if keep_right:
        rewards = rewards - np.float32(keep_right) * on_the_wrong_side(step)
    mixed: Float = (1 - team_share) * rewards + team_share * rewards.mean(1, keepdims=True)
    return mixed
