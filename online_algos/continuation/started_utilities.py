"""VDN and QMIX that begin with the utility networks of an offline run, and its mixers if they fit.

Offline, each seed has two utility networks with LayerNorm, and so has the training that starts from
them. Runs with a behavior head (`--regulariser bc` and `bcq`) act by it and by the utilities, of
which nothing is left without it: they are refused.
"""

from collections.abc import Sequence

from swarmdata.errors import CheckpointError
from swarmdata.learn.networks.optimizer import Descent
from swarmdata.learn.networks.perceptrons import StackedMLP
from swarmdata.learn.networks.team_networks import Team
from swarmdata.learn.policies.choice_policy import BinPolicy, ChoicePolicy
from swarmdata.online_algos.collection.replay_collection import Collector
from swarmdata.online_algos.continuation.offline_start import (
    OfflineStart,
    as_text,
    check_fit,
    frame_name,
    hidden_sizes,
)
from swarmdata.specs.features import Feature

WHEN_STARTED = {"epsilon": "0.1"}
"""Settings of a training that starts from an offline run, where the user gives no others: random
choices would hide what the policies can do."""


def settings_of(start: OfflineStart, features: Sequence[Feature]) -> dict[str, str]:
    """Returns the settings of the run's networks and values, and `WHEN_STARTED`.

    Args:
        start: the run.
        features: of the task's observations.

    Raises:
        CheckpointError: the run's policies do not act by the utilities of bins alone.
    """
    policy = _policy_of(start, start.run.seeds[0])
    return {
        "hidden": as_text(hidden_sizes(policy.layers)),
        "n_critics": str(len(policy.layers[0].weight) // _n_rows(policy, start)),
        "layer_norm": str(policy.layers[0].scale is not None).lower(),
        "parameters": policy.parameters,
        "n_bins": str(policy.choices.n_choices),
        "frame": frame_name(policy.frame, features),
        "discount": str(start.discount),
        "reward_scale": str(start.reward_scale),
        **WHEN_STARTED,
    }


def take_over(
    start: OfflineStart, collector: Collector, team: Team, descent: Descent, fitting: BinPolicy
) -> list[str]:
    """Takes over utility networks, their targets, the statistics of inputs, and mixers that fit.

    Args:
        start: the run.
        collector: whose statistics are replaced.
        team: utility networks that begin.
        descent: of these networks, and of a mixer if there is one.
        fitting: the policy of the first seed as it is before.

    Returns:
        A sentence about each thing that does not fit.

    Raises:
        CheckpointError: the utility networks do not fit.
    """
    seeds = collector.seeds
    policies = [_policy_of(start, seed) for seed in seeds]
    first = policies[0]
    check_fit(start, "utility networks", fitting, first)
    n_rows = len(first.layers[0].weight)
    for k, policy in enumerate(policies):
        team.network.load_layers(slice(k * n_rows, (k + 1) * n_rows), policy.layers)
    descent.targets["team"].load(team.network.flat)
    collector.moments = start.moments(len(seeds))
    return [*_other_rewards(start), *_start_mixer(start, descent, seeds)]


def _other_rewards(start: OfflineStart) -> list[str]:
    """Says that the utilities are of other rewards than those that training goes on with."""
    if not start.has_other_rewards:
        return []
    return [
        f"The values of {start.name} are of other weights of rewards than the task's, with which "
        "training goes on."
    ]


def _start_mixer(start: OfflineStart, descent: Descent, seeds: Sequence[int]) -> list[str]:
    """Copies the mixers of the run if they fit; otherwise says that they do not."""
    if "mixer" not in descent.networks:
        return []
    mine = descent.networks["mixer"]
    theirs = getattr(getattr(start.algorithm, "mixer", None), "network", None)
    if start.is_compact or not isinstance(theirs, StackedMLP) or theirs.shape != mine.shape:
        return [f"The mixer begins anew: {start.name} has none of the same sizes."]
    per_seed = len(mine.flat) // len(seeds)
    for k, seed in enumerate(seeds):
        first = per_seed * start.index(seed)
        mine.flat[k * per_seed : (k + 1) * per_seed] = theirs.flat[first : first + per_seed]
    descent.targets["mixer"].load(mine.flat)
    return []


def _policy_of(start: OfflineStart, seed: int) -> ChoicePolicy:
    """The policy of a seed, if it acts by the utilities of bins alone."""
    policy = start.policy(seed)
    if not isinstance(policy, ChoicePolicy) or policy.behavior or policy.ranges:
        raise CheckpointError(
            f"{start.name} holds policies of {start.run.algorithm} that do not act by the "
            "utilities of bins alone. Start from a run of offline vdn or qmix on continuous "
            "actions with --regulariser none or cql."
        )
    return policy


def _n_rows(policy: ChoicePolicy, start: OfflineStart) -> int:
    return 1 if policy.parameters == "shared" else start.run.n_agents
