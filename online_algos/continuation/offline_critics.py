"""Critics of each robot that an offline actor-critic gives to online training.

`maddpg_bc`, `maddpg_cql`, `cfcql`, `icql_qs` and `iql` have `RobotCritics`, as `maddpg` online has:
these go on, with their slow copies, in the run's units of reward and with its discount. Of all
other runs the critics begin anew: those of `omar` and `facmac_bc` are of other kinds, and values of
the team's reward, or of other weights of rewards, are not those of each robot's own.
"""

from collections.abc import Sequence

from swarmdata.learn.networks.robot_critics import RobotCritics
from swarmdata.online_algos.continuation.offline_start import OfflineStart, as_text, hidden_sizes


def robot_critics_of(start: OfflineStart) -> RobotCritics | str:
    """Returns the run's critics of each robot's own reward; a reason if it has none."""
    critics = getattr(start.algorithm, "critics", None)
    if start.is_compact:
        return "its checkpoint was made small and has none"
    if not isinstance(critics, RobotCritics):
        return f"{start.run.algorithm} has none of each robot"
    if start.run.config["reward"] != "own":
        return "they value the team's reward, not each robot's own"
    if start.has_other_rewards:
        return "they value other weights of rewards than the task's"
    return critics


def settings_of_critics(start: OfflineStart, critics: RobotCritics) -> dict[str, str]:
    """Returns the settings of the critics, of what they value, and a short warm-up, as text."""
    return {
        "critic": critics.critic,
        "critic_hidden": as_text(hidden_sizes(critics.online.layers)),
        "discount": str(start.discount),
        "reward_scale": str(1 / start.statistics.own_return_std),
        "critic_warmup_updates": "500",
    }


def load_critics(mine: RobotCritics, start: OfflineStart, seeds: Sequence[int]) -> list[str]:
    """Copies the run's critics and their slow copies; returns a sentence if they do not fit.

    Args:
        mine: the critics that begin, with rows for each seed.
        start: the run.
        seeds: of `mine`, [K].
    """
    theirs, n = robot_critics_of(start), mine.n_critics
    if isinstance(theirs, str):
        return [f"The critics begin anew, not with those of {start.name}: {theirs}."]
    kinds = [(each.critic, each.n_critics, each.online.shape) for each in (mine, theirs)]
    if kinds[0] != kinds[1]:
        return [
            f"The critics begin anew, not with those of {start.name}: they are {kinds[1]}, "
            f"expected {kinds[0]}. Leave out the settings of the critics to take them over."
        ]
    for k, seed in enumerate(seeds):
        to, index = slice(k * n, (k + 1) * n), start.index(seed)
        of = slice(index * n, (index + 1) * n)
        mine.online.flat[to] = theirs.online.flat[of]
        mine.target.flat[to] = theirs.target.flat[of]
    return []
