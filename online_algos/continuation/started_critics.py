"""Critics of an offline run that an online actor-critic goes on with, where they fit."""

from collections.abc import Sequence
from typing import Protocol

from swarmdata.learn.networks.critics import JointCritics
from swarmdata.online_algos.continuation.offline_start import OfflineStart


class ValueConfig(Protocol):
    """The settings that say what values are of."""

    @property
    def discount(self) -> float: ...
    @property
    def reward_scale(self) -> float: ...


def critics_of(start: OfflineStart) -> JointCritics | None:
    """Returns the run's joint critics with a value for each robot's own reward, if it has them."""
    critics = getattr(start.algorithm, "critics", None)
    if not isinstance(critics, JointCritics) or start.is_compact:
        return None
    is_own = critics.online.shape.outputs == start.run.n_agents
    return critics if is_own and not _other_rewards(start) else None


def _other_rewards(start: OfflineStart) -> bool:
    """Whether the run learned from other rewards than those of its task."""
    return start.run.view is not None and '"rewards"' in start.run.view


def start_critics(
    critics: JointCritics, start: OfflineStart, seeds: Sequence[int], config: ValueConfig
) -> list[str]:
    """Copies the run's critics if they fit; otherwise returns why they begin anew.

    Args:
        critics: of the training that starts, all seeds.
        start: the run.
        seeds: of the training, [K].
        config: its settings.
    """
    theirs = critics_of(start)
    reason = _misfit(critics, theirs, start, config)
    if theirs is None or reason:
        return [f"The critics begin anew: {start.name} {reason}."]
    n_critics = critics.n_critics
    for k, seed in enumerate(seeds):
        first = n_critics * start.index(seed)
        for mine, other in (
            (critics.online, theirs.online),
            (critics.target, theirs.target),
        ):
            mine.flat[k * n_critics : (k + 1) * n_critics] = other.flat[first : first + n_critics]
    return []


def _misfit(
    mine: JointCritics, theirs: JointCritics | None, start: OfflineStart, config: ValueConfig
) -> str:
    """Why the run's critics do not fit; empty if they do."""
    if start.is_compact:
        return "was made small and has no critics"
    if _other_rewards(start):
        return "learned from other rewards than those of the task"
    if theirs is None:
        return "has no joint critics with a value for each robot's own reward"
    ours, shapes = mine.online, (mine.online.shape, theirs.online.shape)
    if shapes[0] != shapes[1] or mine.n_critics != theirs.n_critics:
        return (
            f"has {theirs.n_critics} critics of sizes {shapes[1]}, expected {mine.n_critics} of "
            f"{ours.shape}"
        )
    values = (config.discount, config.reward_scale), (start.discount, start.reward_scale)
    if values[0] != values[1]:
        return (
            f"has values of discount {values[1][0]:g} and rewards times {values[1][1]:g}, expected "
            f"{values[0][0]:g} and {values[0][1]:g}"
        )
    return ""
