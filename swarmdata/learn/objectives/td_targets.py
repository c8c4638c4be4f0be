"""Temporal-difference targets and errors, team rewards, slowly moving targets."""

from torch import Tensor

from swarmdata.learn.networks.perceptrons import StackedLayers


def team_reward(rewards: Tensor) -> Tensor:
    """Returns team rewards, [...]: the mean over agents of rewards [..., N]."""
    return rewards.mean(-1)


def td_target(
    rewards: Tensor, terminations: Tensor, next_values: Tensor, discount: float
) -> Tensor:
    """Returns r + discount * (1 - termination) * V(s').

    A truncation does not stop the bootstrap: the horizon cut the episode, the task went on. It
    needs `next_values` of the state that was reached, never of the next episode's first state
    (Pardo et al. 2018, "Time limits in reinforcement learning", section 3).

    Args:
        rewards: team rewards, [...].
        terminations: whether the task ended, bool [...].
        next_values: values of the states reached, [...].
        discount: factor per step, 0 to 1.
    """
    return rewards + discount * (~terminations) * next_values


def td_error(q: Tensor, y: Tensor) -> Tensor:
    """Returns sum_j (Q_j - y)^2, the mean over rows, [K].

    Args:
        q: values that J critics give, [K, J, B].
        y: targets, [K, B].
    """
    return (q - y[:, None]).square().mean(2).sum(1)


def move_target(target: StackedLayers, online: StackedLayers, rate: float) -> None:
    """Moves the target's parameters by `rate` of their distance to the online ones, in place."""
    target.flat.lerp_(online.flat, rate)
